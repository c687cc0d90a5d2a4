#pragma once

#include <algorithm>
#include <concepts>
#include <filesystem>
#include <ios>
#include <iterator>
#include <locale>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <rbres/core/error.hpp>
#include <rbres/io/architecture.hpp>
#include <rbres/io/atomic_file.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/nn/constant_network.hpp>

namespace rbres::RBRES_ABI {

namespace detail {

/// Whether a namespace of one's own may have this name: an identifier that C++ neither takes for itself nor
/// reserves ([lex.key], [lex.name], [namespace.std]), no macro by its looks, and not this library's.
inline bool is_namespace_name(std::string_view name) {
  constexpr std::string_view letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_";
  constexpr std::string_view taken[] = {
      "alignas",     "alignof",  "and",        "and_eq",    "asm",       "auto",         "bitand",
      "bitor",       "bool",     "break",      "case",      "catch",     "char",         "char16_t",
      "char32_t",    "char8_t",  "class",      "co_await",  "co_return", "co_yield",     "compl",
      "concept",     "const",    "const_cast", "consteval", "constexpr", "constinit",    "continue",
      "decltype",    "default",  "delete",     "do",        "double",    "dynamic_cast", "else",
      "enum",        "explicit", "export",     "extern",    "false",     "float",        "for",
      "friend",      "goto",     "if",         "inline",    "int",       "long",         "mutable",
      "namespace",   "new",      "noexcept",   "not",       "not_eq",    "nullptr",      "operator",
      "or",          "or_eq",    "private",    "protected", "public",    "register",     "reinterpret_cast",
      "requires",    "return",   "short",      "signed",    "sizeof",    "static",       "static_assert",
      "static_cast", "struct",   "switch",     "template",  "this",      "thread_local", "throw",
      "true",        "try",      "typedef",    "typeid",    "typename",  "union",        "unsigned",
      "using",       "virtual",  "void",       "volatile",  "wchar_t",   "while",        "xor",
      "xor_eq",      "main",     "posix",      "errno",     "stdin",     "stdout",       "stderr",
      "assert",      "linux",    "unix",       "std",       "Eigen",     "rbres"};
  if (name.empty() || name.front() == '_' || letters.find(name.front()) == name.npos) return false;
  if (name.find_first_not_of(text(letters, "0123456789")) != name.npos || name.find("__") != name.npos)
    return false;
  // Names without a small letter are macros, such as NULL.
  if (name.find_first_of("abcdefghijklmnopqrstuvwxyz") == name.npos) return false;
  const bool is_std = name.starts_with("std") && name.find_first_not_of("0123456789", 3) == name.npos;
  return !is_std && std::find(std::begin(taken), std::end(taken), name) == std::end(taken);
}

/// Refuses what cannot name the namespace of an exported header.
inline void check_namespace_name(std::string_view name) {
  if (!is_namespace_name(name))
    refuse("export_header", "a name of letters, digits and _ that C++ and rbres leave free",
           text("'", name, "'"));
}

template <std::floating_point T>
constexpr std::string_view scalar_name = std::is_same_v<T, float> ? "float" : "double";

/// A C++ array of hexadecimal floats, which lose no bit. Error naming `what` where one is not finite.
template <std::floating_point T>
std::string array_text(std::string_view name, const std::string& what, std::span<const T> numbers) {
  require_finite(what, numbers.data(), numbers.size());
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << "inline constexpr " << scalar_name<T> << ' ' << name << '[' << std::dec << numbers.size() << "] = {"
      << std::hexfloat;
  for (std::size_t i = 0; i < numbers.size(); ++i)
    out << (i % 8 == 0 ? "\n" : "") << numbers[i] << (std::is_same_v<T, float> ? "f," : ",");
  out << "\n};\n";
  return out.str();
}

/// Error naming the tensor where a weight of a network is not finite.
template <class Network>
void check_weights(const Network& network, const std::filesystem::path& path) {
  const auto block = network.parameters();
  for (const ParameterTensor& tensor : Network::tensors()) {
    std::vector<typename Network::Weight> numbers;
    for (int row = 0; row < tensor.rows; ++row)
      for (int column = 0; column < tensor.columns; ++column)
        numbers.push_back(block[tensor.index(row, column)]);
    require_finite(text(path.string(), ": tensor '", tensor.name, "'"), numbers.data(), numbers.size());
  }
}

/// The same array of numbers of half a float's size, as their bits.
inline std::string array_text(std::string_view name, std::span<const bfloat16> numbers) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << "inline constexpr std::uint16_t " << name << '[' << numbers.size() << "] = {" << std::hex;
  for (std::size_t i = 0; i < numbers.size(); ++i)
    out << (i % 12 == 0 ? "\n0x" : "0x") << numbers[i].bits << ',';
  out << "\n};\n";
  return out.str();
}

/// How the name of a type ends whose last argument, what weights are kept in, is written where it is not T.
template <class T, class W>
constexpr std::string_view weight_argument = std::is_same_v<T, W> ? ">" : ", rbres::bfloat16>";

/// The type of a network, spelled in C++.
template <class T, class Layers, class W>
std::string network_text(const Network<T, Layers, W>&) {
  return text("rbres::Network<", scalar_name<T>, ", ", LayerName<Layers>::text(LayerText::spelled),
              weight_argument<T, W>);
}

/// The array `weights` of a block of parameters. Error naming the path where one of full size is not finite.
template <class W>
std::string weights_text(std::span<const W> block, const std::filesystem::path& path) {
  if constexpr (std::is_same_v<W, bfloat16>) {
    return text(array_text("weight_bits", block), "alignas(64) inline constexpr auto weights =\n",
                "    __builtin_bit_cast(std::array<rbres::bfloat16, ", block.size(), ">, weight_bits);\n");
  } else {
    return text("alignas(64) ", array_text<W>("weights", path.string(), block));
  }
}

/// A network as the array `weights` of all its parameters, in the order of its block, and the type `Network`
/// that reads them there. Error naming the path where one is not finite.
template <class T, class Layers, class W>
std::string constant_network_text(const Network<T, Layers, W>& network, const std::filesystem::path& path) {
  check_weights(network, path);
  return text(weights_text(network.parameters(), path), "using Network = rbres::ConstantNetwork<",
              network_text(network), ", weights>;\n");
}

}  // namespace detail

/// Writes a C++ header that holds the network, so that a program without files runs it with rbres and Eigen
/// alone:
///
///     #include "model.hpp"
///     const NAME::Network network = NAME::network();
///     y = network.forward(x);
///
/// The weights stand there as a constexpr array of hexadecimal floats, or of the bits of a bfloat16, which
/// lose no bit, and are read where the compiler puts them: a ConstantNetwork, which needs no heap. Atomic;
/// see AtomicFile for the errors. Error too when a number is not finite or `name` is no name for a namespace
/// of one's own.
template <std::floating_point T, class Layers, class W>
void export_header(const Network<T, Layers, W>& network, const std::filesystem::path& path,
                   std::string_view name = "rbres_model") {
  detail::check_namespace_name(name);
  const std::string constants = detail::constant_network_text(network, path);
  AtomicFile file(path);
  const std::string text = detail::text(
      "// Written by rbres::export_header.\n#pragma once\n\n#include <rbres/nn/constant_network.hpp>\n\n"
      "namespace ",
      name, "::RBRES_ABI {\n\n", constants, "\ninline Network network() { return {}; }\n\n}  // namespace ",
      name, "\n");
  file.write(text.data(), text.size());
  file.commit();
}

}  // namespace rbres::RBRES_ABI
