// The reader of headers against nlohmann_json: what it accepts is JSON and means the same, and it refuses no
// JSON that is a header.
#include "io_support.hpp"

#include <cstdint>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include <nlohmann/json.hpp>

#include <rbres/core/philox.hpp>
#include <rbres/io/safetensors_header.hpp>

using namespace rbres;
using nlohmann::json;

namespace {

struct Header {
  Metadata metadata;
  std::map<std::string, std::vector<std::uint64_t>> tensors;  ///< offsets, extents
  std::map<std::string, std::string> dtypes;
  bool operator==(const Header&) const = default;
};

std::optional<Header> read(std::string_view text) {
  const std::filesystem::path path = "a";
  Header found;
  std::map<std::string, TensorInfo> tensors;
  const std::string error =
      error_of([&] { detail::SafetensorsHeader(path, text, found.metadata, tensors).read(); });
  CAPTURE(error);
  CHECK((error.empty() || error.starts_with("a: expected sizes below 2^63, found ") ||
         (error.starts_with("a: safetensors header: expected ") && contains(error, ", found "))));
  if (!error.empty()) return {};
  for (const auto& [name, tensor] : tensors) {
    found.dtypes[name] = tensor.dtype;
    std::vector<std::uint64_t> numbers{tensor.offsets[0], tensor.offsets[1]};
    for (const Eigen::Index extent : tensor.shape) numbers.push_back(static_cast<std::uint64_t>(extent));
    found.tensors[name] = numbers;
  }
  return found;
}

/// Numbers of 0 or more below 2^63; nothing where there is anything else.
std::optional<std::vector<std::uint64_t>> numbers(const json& array, std::size_t most) {
  if (!array.is_array() || array.size() > most) return {};
  std::vector<std::uint64_t> all;
  for (const json& one : array) {
    if (!one.is_number_unsigned() || one.get<std::uint64_t>() >> 63 != 0) return {};
    all.push_back(one.get<std::uint64_t>());
  }
  return all;
}

/// What nlohmann_json reads.
std::optional<Header> expected(std::string_view text) {
  std::vector<std::set<std::string>> keys;
  bool is_twice = false;
  const json all = json::parse(
      text,
      [&](int, json::parse_event_t event, json& value) {
        if (event == json::parse_event_t::object_start) keys.emplace_back();
        if (event == json::parse_event_t::object_end) keys.pop_back();
        if (event == json::parse_event_t::key) is_twice |= !keys.back().insert(value).second;
        return true;
      },
      false);
  if (!all.is_object() || is_twice) return {};
  Header found;
  for (const auto& [name, value] : all.items()) {
    if (!value.is_object()) return {};
    if (name == "__metadata__") {
      for (const auto& [key, words] : value.items()) {
        if (!words.is_string()) return {};
        found.metadata[key] = words;
      }
      continue;
    }
    if (value.size() != 3 || !value.contains("dtype") || !value.contains("shape") ||
        !value.contains("data_offsets"))
      return {};
    const auto shape = numbers(value["shape"], 8), offsets = numbers(value["data_offsets"], 2);
    if (!value["dtype"].is_string() || detail::safetensors_dtype_size(value["dtype"].get<std::string>()) == 0)
      return {};
    if (!shape || !offsets || offsets->size() != 2) return {};
    found.dtypes[name] = value["dtype"];
    found.tensors[name] = *offsets;
    found.tensors[name].insert(found.tensors[name].end(), shape->begin(), shape->end());
  }
  return found;
}

/// Headers with spaces, escapes and numbers of every kind.
class Maker {
 public:
  explicit Maker(std::uint64_t seed) : random_(seed) {}

  std::size_t below(std::size_t count) {
    return static_cast<std::size_t>(random_.uniform(0, 1) * static_cast<double>(count)) % count;
  }
  std::string header() {
    return object(below(4), [&](std::size_t i) {
      if (i == 0)
        return "\"__metadata__\"" + colon() +
               object(below(4), [&](std::size_t) { return string() + colon() + string(); });
      return string() + colon() + tensor();
    });
  }
  std::string mutated(std::string text) {
    for (std::size_t i = below(4); i > 0 && !text.empty(); --i) {
      const std::size_t at = below(text.size());
      if (const std::size_t kind = below(4); kind == 0)
        text.erase(at, 1 + below(3));
      else if (kind == 1)
        text[at] = static_cast<char>(1 + below(255));  // see the case of '\0'
      else
        text.insert(at, kind == 2 ? part() : text.substr(below(text.size()), below(20)));
    }
    return text;
  }

 private:
  std::string part() {
    static const std::vector<std::string> parts{"\"",
                                                "\\",
                                                "{",
                                                "}",
                                                "[",
                                                "]",
                                                ",",
                                                ":",
                                                "-",
                                                "0",
                                                ".5",
                                                "e1",
                                                " ",
                                                "\n",
                                                "null",
                                                "true",
                                                "\\u0041",
                                                "\\uD83d\\uDe00",
                                                "\\ud800",
                                                "\\udc00",
                                                "\\u12g4",
                                                "\x7f",
                                                "\x1f",
                                                "\xc3\xa9",
                                                "\xe2\x82\xac",
                                                "\xf0\x9f\x98\x80",
                                                "\xed\xa0\x80",
                                                "\xc0\x80",
                                                "\xf4\x90\x80\x80",
                                                "\xe2\x82",
                                                "18446744073709551616",
                                                "9223372036854775808",
                                                "//",
                                                "/* */",
                                                "\"dtype\"",
                                                "\"__metadata__\""};
    return parts[below(parts.size())];
  }
  std::string string() {
    static const std::vector<std::string> parts{"a",
                                                "b",
                                                "weight",
                                                "0.",
                                                "\\\"",
                                                "\\\\",
                                                "\\/",
                                                "\\b",
                                                "\\f",
                                                "\\n",
                                                "\\r",
                                                "\\t",
                                                "\\u0000",
                                                "\\u001F",
                                                "\\u00e9",
                                                "\\u20AC",
                                                "\\ud83d\\ude00",
                                                "\\uDBFF\\uDFFF",
                                                "\\uffff",
                                                "\xc3\xa9",
                                                "\xe2\x82\xac",
                                                "\xed\x9f\xbf",
                                                "\xf0\x90\x80\x80",
                                                "\xf4\x8f\xbf\xbf",
                                                "\x7f",
                                                " ",
                                                "{",
                                                "sha256"};
    std::string out = "\"";
    for (std::size_t i = below(5); i > 0; --i) out += parts[below(parts.size())];
    return out + '"';
  }
  std::string number() {
    static const std::vector<std::string> numbers{"0",
                                                  "1",
                                                  "7",
                                                  "10",
                                                  "4294967296",
                                                  "9223372036854775807",
                                                  "9223372036854775808",
                                                  "18446744073709551615",
                                                  "18446744073709551616",
                                                  "184467440737095516160",
                                                  "-1",
                                                  "-0",
                                                  "1.0",
                                                  "1e3",
                                                  "01",
                                                  "1E-2",
                                                  "0x1"};
    return numbers[below(below(8) == 0 ? numbers.size() : 6)];
  }
  std::string tensor() {
    static const std::vector<std::string> dtypes{"F32", "F64", "BF16", "I64", "U8", "F\\u0033\\u0032", "F31"};
    const std::size_t first = below(3);
    return object(3, [&](std::size_t i) {
      if ((i + first) % 3 == 0)
        return "\"dtype\"" + colon() + '"' + dtypes[below(below(8) == 0 ? dtypes.size() : 6)] + '"';
      const bool is_shape = (i + first) % 3 == 1;
      const std::size_t count = is_shape ? below(below(8) == 0 ? 10 : 4) : below(16) == 0 ? below(4) : 2;
      return (is_shape ? "\"shape\"" : "\"data_offsets\"") + colon() +
             list('[', ']', count, [&](std::size_t) { return number(); });
    });
  }
  std::string space() {
    static const std::vector<std::string> spaces{"", "", "", " ", "\n", "\t", "\r", "  "};
    return spaces[below(spaces.size())];
  }
  std::string colon() { return space() + ':' + space(); }
  template <class Make>
  std::string object(std::size_t count, const Make& make) {
    return list('{', '}', count, make);
  }
  template <class Make>
  std::string list(char open, char close, std::size_t count, const Make& make) {
    std::string out = open + space();
    for (std::size_t i = 0; i < count; ++i) out += (i > 0 ? "," : "") + space() + make(i) + space();
    return out + close;
  }

  Random random_;
};

}  // namespace

TEST_CASE("headers mean what nlohmann_json reads, and what it refuses is refused") {
  int accepted = 0, refused = 0;
  for (std::uint64_t seed = 0; seed < 20'000; ++seed) {
    Maker maker(seed);
    const std::string whole = maker.header() + std::string(maker.below(3), ' ');
    const std::string text = maker.mutated(whole);
    CAPTURE(text);
    const auto found = read(text);
    CHECK((found == expected(text)));
    ++(found ? accepted : refused);
  }
  CHECK(accepted > 4'000);
  CHECK(refused > 4'000);
}

TEST_CASE("JSON ends with the header") {
  using namespace std::string_literals;
  CHECK(read("{} \n"));
  for (const auto& text :
       {""s, " "s, "{"s, "{}}"s, "{}{}"s, "{}\0"s, "{\0}"s, "{\"a"s, "{\"\\"s, "{\"\\u12"s, "{\"\\ud83d\\u"s,
        "{\"a\":{\"shape\":[1"s, "{\"a\":{\"shape\":[1,]}}"s, "{,}"s, "{\"a\" {}}"s}) {
    CAPTURE(text);
    CHECK(!read(text));
  }
}

TEST_CASE("strings are written as nlohmann_json writes them, and come back") {
  std::string all;
  for (int c = 0; c < 128; ++c) all += static_cast<char>(c);
  for (const std::string& text :
       {all, std::string("\xc3\xa9 \xe2\x82\xac \xf0\x9f\x98\x80"), std::string()}) {
    CHECK(detail::json_string(text) == json(text).dump());
    std::size_t at = 0;
    std::string back;
    CHECK(detail::read_quoted(detail::json_string(text), at, back));
    CHECK(back == text);
    CHECK(at == detail::json_string(text).size());
  }
}

TEST_CASE("UTF-8 is what nlohmann_json takes for it") {
  for (int first = 0; first < 256; ++first)
    for (int second = 0; second < 256; ++second)
      for (const char* rest : {"", "\x80", "\xbf\x80", "a"}) {
        const std::string text = std::string{static_cast<char>(first), static_cast<char>(second)} + rest;
        const auto ignore = json::error_handler_t::ignore;
        if (detail::is_utf8(text) != (json::parse(json(text).dump(-1, ' ', false, ignore)) == text))
          FAIL_CHECK(first, " ", second, " ", rest);
      }
}
