#pragma once

#include <nlohmann/json.hpp>

#include <rbres/core/abi.hpp>

/// @file
/// Apart from json_file.hpp, whose functions compile a second type of JSON.
namespace rbres::RBRES_ABI::detail {

/// Whether all names and strings are UTF-8, as JSON must be.
template <class AnyJson>
bool is_utf8(const AnyJson& json) {
  // What is not is left out of the text, which then says something else.
  return AnyJson::parse(json.dump(-1, ' ', false, AnyJson::error_handler_t::ignore)) == json;
}

}  // namespace rbres::RBRES_ABI::detail
