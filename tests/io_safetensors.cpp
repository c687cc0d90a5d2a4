#include "io_read_all.hpp"
#include "io_support.hpp"

#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include <rbres/io/safetensors.hpp>

using namespace rbres;
using Eigen::Index;

namespace {

/// A safetensors file with this header and data.
std::string safetensors(const std::string& header, const std::string& data) {
  const std::uint64_t size = header.size();
  std::string bytes(8, '\0');
  std::memcpy(bytes.data(), &size, 8);
  return bytes + header + data;
}

}  // namespace

TEST_CASE("round trip of every type, of shapes and metadata") {
  const TemporaryFolder folder;
  const auto path = folder / "a.safetensors";
  const std::vector<float> weight{1, 2, 3, 4, 5, 6};
  const double pi = 3.14159265358979;
  const std::vector<std::int64_t> negative{-1, 2};
  const std::uint64_t large = ~0ull;
  const std::vector<std::uint8_t> bytes{1, 2, 3};
  SafetensorsWriter writer;
  writer.add("0.weight", {2, 3}, weight.data());
  writer.add("pi", {}, &pi);
  writer.add("negative", {2, 1, 1}, negative.data());
  writer.add("large", {1}, &large);
  writer.add("bytes \"quoted\" \xc3\xa9", {3}, bytes.data());
  writer.add("nothing", {0, 4}, weight.data());
  writer.metadata = {{"key", "value \"quoted\"\n"}, {"", ""}};
  writer.write(path);

  const SafetensorsReader file(path);
  CHECK(file.metadata() == writer.metadata);
  CHECK(file.tensors().size() == 6);
  CHECK(file.tensors().at("0.weight").dtype == "F32");
  const auto check = [&](const std::string& name, const std::vector<Index>& shape, const auto& expected) {
    auto values = expected;
    for (auto& value : values) value = 0;
    file.read(name, shape, values.data());
    CHECK(values == expected);
  };
  check("0.weight", {2, 3}, weight);
  check("pi", {}, std::vector<double>{pi});
  check("negative", {2, 1, 1}, negative);
  check("large", {1}, std::vector<std::uint64_t>{large});
  check("bytes \"quoted\" \xc3\xa9", {3}, bytes);
  check("nothing", {0, 4}, std::vector<float>{});
  for (const auto& [name, tensor] : file.tensors())  // aligned from the start of the file
    if (tensor.dtype != "U8") CHECK(tensor.offsets[0] % 4 == 0);
}

TEST_CASE("what is asked for must be there") {
  const TemporaryFolder folder;
  const auto path = folder / "a.safetensors";
  const std::vector<float> values{1, 2, 3, 4, 5, 6};
  SafetensorsWriter writer;
  writer.add("weight", {2, 3}, values.data());
  writer.write(path);
  const SafetensorsReader file(path);
  std::vector<float> read(6);
  std::vector<double> wide(6);
  const std::string name = path.string() + ": tensor ";
  CHECK(error_of([&] { file.read("bias", {2}, read.data()); }) == name + "'bias' is missing");
  CHECK(error_of([&] {
          file.read("weight", {3, 2}, read.data());
        }) == name + "'weight': expected shape [3, 2], found [2, 3]");
  CHECK(error_of([&] {
          file.read("weight", {2, 3}, wide.data());
        }) == name + "'weight': expected dtype F64, found F32");
}

TEST_CASE("what cannot be written is refused") {
  const TemporaryFolder folder;
  const float values[] = {1, std::numeric_limits<float>::infinity()};
  SafetensorsWriter writer;
  writer.add("a", {1}, values);
  CHECK(contains(error_of([&] { writer.add("a", {1}, values); }), "found 'a' twice"));
  CHECK_THROWS_AS(writer.add("__metadata__", {1}, values), Error);
  for (const std::vector<Index>& shape :
       {std::vector<Index>{-1}, {-1, -1}, {Index{1} << 32, Index{1} << 32}, {Index{1} << 62}})
    CHECK(contains(error_of([&] { writer.add("wrong", shape, values); }),
                   "tensor 'wrong': expected a shape of less than 2^63 bytes, found ["));
  writer.metadata["key"] = "\xff";
  CHECK(contains(error_of([&] { writer.write(folder / "a"); }), "names and metadata in UTF-8"));
  writer.metadata["key"] = "";
  writer.add<float>("filled", {2}, [](float* to) { to[0] = 1, to[1] = 2; });
  CHECK(error_of([&] { writer.write(folder / "a"); }) == "");
  writer.add("b", {2}, values);
  CHECK(error_of([&] { writer.write(folder / "b"); }) ==
        (folder / "b").string() + ": tensor 'b': expected finite numbers, found inf at index 1");
  CHECK(!std::filesystem::exists(folder / "b"));
  float filled[2];
  SafetensorsReader(folder / "a").read("filled", {2}, filled);
  CHECK(filled[1] == 2);
}

TEST_CASE("malformed files are refused with what is wrong") {
  const TemporaryFolder folder;
  const auto path = folder / "a.safetensors";
  const std::string four("\0\0\x80\x3f", 4), eight = four + four;  // 1 in float
  const auto error = [&](const std::string& bytes) {
    write_bytes(path, bytes);
    const std::string message = error_of([&] { read_all_tensors(path); });
    CHECK(message.starts_with(path.string() + ": "));
    return message;
  };
  const auto header_error = [&](const std::string& header) { return error(safetensors(header, eight)); };
  const auto tensor_error = [&](const std::string& shape, const std::string& offsets) {
    return header_error(R"({"a":{"dtype":"F32","shape":)" + shape + R"(,"data_offsets":)" + offsets + "}}");
  };
  const std::string a = R"("a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]})";
  const std::string b = R"("b":{"dtype":"F32","shape":[1],"data_offsets":[4,8]})";
  const std::string valid = safetensors("{" + a + "," + b + R"(,"__metadata__":{"k":"v"}})", eight);
  write_bytes(path, valid);
  CHECK(error_of([&] { read_all_tensors(path); }) == "");

  // The frame.
  CHECK(error("") == path.string() + ": expected a safetensors file, found a file of 0 bytes");
  CHECK(contains(error("1234567"), "expected a safetensors file, found a file of 7 bytes"));
  CHECK(contains(error(std::string(8, '\xff') + "{}"), "found a length of 18446744073709551615"));
  CHECK(contains(error(std::string("\x03\0\0\0\0\0\0\0{}", 10)), "within 10 bytes, found a length of 3"));
  CHECK(contains(error("GGUF, or something else"), "a safetensors header within"));
  CHECK(contains(header_error(" {" + a + "," + b + "}"), "no { at byte 8"));
  CHECK(contains(header_error("[]"), "no { at byte 8"));
  CHECK(contains(header_error(""), "no { at byte 8"));
  // JSON.
  CHECK(contains(header_error("{" + a + "," + b), "safetensors header: expected JSON, found"));
  CHECK(contains(header_error("{" + a + "," + b + "}}"), "expected JSON"));
  CHECK(contains(header_error("{\"\xff\":1}"), "expected JSON"));
  CHECK(contains(header_error("{" + a + "," + a + "}"), "each key once, found 'a' twice"));
  CHECK(contains(header_error("{\"__metadata__\":{},\"__metadata__\":{}}"), "found '__metadata__' twice"));
  CHECK(contains(header_error("{\"__metadata__\":{\"k\":\"\",\"k\":\"\"}}"), "found 'k' twice"));
  CHECK(contains(header_error("{\"__metadata__\":{\"k\":1}}"), "found a number under '__metadata__'"));
  CHECK(contains(header_error("{\"__metadata__\":{\"k\":{}}}"), "found an object under '__metadata__'"));
  CHECK(contains(header_error("{\"__metadata__\":[]}"), "found an array"));
  CHECK(contains(header_error("{\"a\":null}"), "found null under 'a'"));
  CHECK(contains(header_error("{\"a\":true}"), "found a boolean"));
  CHECK(contains(header_error("{\"a\":{}}"), "a tensor that lacks one"));
  CHECK(contains(header_error(R"({"a":{"dtype":"F32","dtype":"F32"}})"), "found 'dtype' twice"));
  CHECK(contains(header_error(R"({"a":{"more":1}})"), "found 'more'"));
  CHECK(contains(header_error(R"({"a":{"dtype":"F31"}})"), "found 'F31'"));
  CHECK(contains(header_error(R"({"a":{"dtype":4}})"), "found a number"));
  CHECK(contains(header_error("{\"a\":" + std::string(1'000'000, '[')), "found an array under 'a'"));
  std::string deep;
  for (int i = 0; i < 100'000; ++i) deep += "{\"a\":";
  CHECK(contains(header_error(deep), "found 'a'"));
  // Shapes and offsets.
  CHECK(contains(tensor_error("[-1]", "[0,8]"), "found a negative number"));
  CHECK(contains(tensor_error("[2.0]", "[0,8]"), "found a fraction"));
  CHECK(contains(tensor_error("[[2]]", "[0,8]"), "found an array"));
  CHECK(contains(tensor_error("2", "[0,8]"), "found a number"));
  CHECK(contains(tensor_error("[1,1,1,1,1,1,1,1,2]", "[0,8]"), "at most 8 dimensions"));
  CHECK(contains(tensor_error("[2]", "[0]"), "two data_offsets, found 1"));
  CHECK(contains(tensor_error("[2]", "[0,8,8]"), "two data_offsets, found more"));
  CHECK(contains(tensor_error("[18446744073709551615]", "[0,8]"), "sizes below 2^63"));
  CHECK(contains(tensor_error("[99999999999999999999]", "[0,8]"), "found a fraction"));
  CHECK(contains(tensor_error("[4294967296,4294967296]", "[0,8]"), "sizes below 2^63"));
  CHECK(contains(tensor_error("[250000000000]", "[0,1000000000000]"),
                 "expected 1000000000000 bytes of tensors"));
  CHECK(contains(tensor_error("[3]", "[0,8]"), "expected 12 bytes, as its shape says, found offsets 0 to 8"));
  CHECK(contains(tensor_error("[2]", "[8,0]"), "expected data from offset 0, found 8"));
  CHECK(contains(tensor_error("[0]", "[0,0]"), "expected 0 bytes of tensors, as the header says, found 8"));
  CHECK(contains(tensor_error("[1]", "[4,8]"), "expected data from offset 0, found 4"));
  CHECK(contains(tensor_error("[1]", "[0,4]"), "expected 4 bytes of tensors"));
  CHECK(contains(tensor_error("[3]", "[0,12]"), "expected 12 bytes of tensors, as the header says, found 8"));
  CHECK(contains(header_error("{" + a + R"(,"b":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}})"),
                 "tensor 'b': expected data from offset 4, found 0"));
  // Numbers.
  write_bytes(path, safetensors("{" + a + "," + b + "}", four + std::string("\0\0\xc0\x7f", 4)));
  CHECK(contains(error_of([&] { read_all_tensors(path); }),
                 "tensor 'b': expected finite numbers, found nan at index 0"));

  check_other_lengths_refused(path, valid, read_all_tensors);
  CHECK(check_changed_bytes(path, valid, read_all_tensors) > 1000);
}
