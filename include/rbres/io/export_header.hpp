#pragma once

#include <concepts>
#include <filesystem>
#include <ios>
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

/// Writes a C++ header that holds the network, so that a program without files runs it with rbres and Eigen
/// alone:
///     #include "model.hpp"
///     const NAME::Network network = NAME::network();
///     y = network.forward(x);
/// The weights stand there as a constexpr array of hexadecimal floats, which lose no bit: weight (row by row)
/// and bias of every Linear. Atomic; see AtomicFile for the errors. Error too when a number is not finite or
/// `name` is no name.
template <std::floating_point T, class Layers>
void export_header(const Network<T, Layers>& network, const std::filesystem::path& path,
                   std::string_view name = "rbres_model") {
  constexpr std::string_view letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_";
  if (name.empty() || letters.find(name.front()) == std::string_view::npos ||
      name.find_first_not_of(detail::text(letters, "0123456789")) != std::string_view::npos)
    detail::refuse("export_header", "a name of letters, digits and _", detail::text("'", name, "'"));
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
