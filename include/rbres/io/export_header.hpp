#pragma once

#include <algorithm>
#include <concepts>
#include <filesystem>
#include <ios>
#include <iterator>
#include <locale>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>

#include <rbres/core/error.hpp>
#include <rbres/io/architecture.hpp>
#include <rbres/io/atomic_file.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/nn/network.hpp>

namespace rbres {

namespace detail {

/// Whether a namespace of one's own may have this name: an identifier that C++ neither takes for itself nor
/// reserves ([lex.key], [lex.name], [namespace.std]), and not this library's.
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
      "xor_eq",      "main",     "posix",      "std",       "Eigen",     "rbres"};
  if (name.empty() || name.front() == '_' || letters.find(name.front()) == name.npos) return false;
  if (name.find_first_not_of(text(letters, "0123456789")) != name.npos || name.find("__") != name.npos)
    return false;
  const bool is_std = name.starts_with("std") && name.find_first_not_of("0123456789", 3) == name.npos;
  return !is_std && std::ranges::find(taken, name) == std::end(taken);
}

}  // namespace detail

/// Writes a C++ header that holds the network, so that a program without files runs it with rbres and Eigen
/// alone:
///     #include "model.hpp"
///     const NAME::Network network = NAME::network();
///     y = network.forward(x);
/// The weights stand there as a constexpr array of hexadecimal floats, which lose no bit: weight (row by row)
/// and bias of every Linear. Atomic; see AtomicFile for the errors. Error too when a number is not finite or
/// `name` is no name for a namespace of one's own.
template <std::floating_point T, class Layers>
void export_header(const Network<T, Layers>& network, const std::filesystem::path& path,
                   std::string_view name = "rbres_model") {
  if (!detail::is_namespace_name(name))
    detail::refuse("export_header", "a name of letters, digits and _ that C++ and rbres leave free",
                   detail::text("'", name, "'"));
  constexpr bool is_float = std::is_same_v<T, float>;
  constexpr std::string_view scalar = is_float ? "float" : "double";
  using Model = Network<T, Layers>;

  AtomicFile file(path);
  const auto write = [&file](const std::string& text) { file.write(text.data(), text.size()); };
  write("// Written by rbres::export_header.\n#pragma once\n\n#include <rbres/nn/network.hpp>\n\n");
  write(detail::text("namespace ", name, " {\n\nusing Network = rbres::Network<", scalar, ", "));
  write(detail::text(detail::LayerName<Layers>::text(detail::LayerText::spelled), ">;\n\n"));
  write(detail::text("inline constexpr ", scalar, " weights[", Model::parameter_count, "] = {\n"));
  for (const ParameterTensor& tensor : Model::tensors()) {
    for (int row = 0; row < tensor.rows; ++row) {
      std::ostringstream numbers;
      numbers.imbue(std::locale::classic());
      numbers << std::hexfloat;
      for (int column = 0; column < tensor.columns; ++column) {
        const T number = network.parameters()[tensor.index(row, column)];
        detail::require_finite(detail::text(path.string(), ": tensor '", tensor.name, "'"), &number, 1);
        numbers << number << (is_float ? "f," : ",");
      }
      write(numbers.str() + "\n");
    }
  }
  write(R"(};

inline Network network() {
  Network network;
  const auto* from = weights;
  for (const rbres::ParameterTensor& tensor : Network::tensors())
    for (int row = 0; row < tensor.rows; ++row)
      for (int column = 0; column < tensor.columns; ++column) network.parameters()[tensor.index(row, column)] = *from++;
  return network;
}

}  // namespace )");
  write(detail::text(name, "\n"));
  file.commit();
}

}  // namespace rbres
