#include "io_support.hpp"

#include <cstdint>

#include <rbres/io/npy.hpp>

using namespace rbres;
using Eigen::Index;

namespace {

template <class Scalar>
Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic> counting(Index rows, Index columns) {
  return Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>::NullaryExpr(
      rows, columns, [rows](Index row, Index column) { return static_cast<Scalar>(row + rows * column); });
}

/// A .npy file of the given version with this dictionary and data.
std::string npy(char version, std::string dictionary, const std::string& data) {
  dictionary += '\n';
  std::string size{static_cast<char>(dictionary.size() & 0xff), static_cast<char>(dictionary.size() >> 8)};
  if (version > 1) size += std::string(2, '\0');
  return "\x93NUMPY" + std::string{version, '\0'} + size + dictionary + data;
}

const std::string eight_bytes("\0\0\x80\x3f\0\0\0\x40", 8);  // 1, 2 in float

}  // namespace

TEST_CASE("the bytes are NumPy's own") {
  const TemporaryFolder folder;
  write_npy(folder / "a.npy", Eigen::RowVector2f(1, 2).eval());
  const std::string head = "\x93NUMPY\x01";
  const std::string bytes = read_bytes(folder / "a.npy");
  CHECK(bytes.size() == 128 + 8);
  CHECK(bytes.substr(0, 10) == head + std::string("\0\x76\0", 3));
  const std::string dictionary = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1), }";
  CHECK(bytes.substr(10, 118) == dictionary + std::string(117 - dictionary.size(), ' ') + '\n');
  CHECK(bytes.substr(128) == eight_bytes);
}

TEST_CASE_TEMPLATE("round trips", Scalar, float, double, std::int32_t, std::int64_t, std::uint8_t) {
  const TemporaryFolder folder;
  const auto path = folder / "a.npy";
  const auto columns = counting<Scalar>(6, 7);
  for (const auto& sample_shape : {std::vector<Index>{6}, {2, 3}, {6, 1}, {3, 1, 2}}) {
    NpyWriter<Scalar> writer(path, sample_shape);
    writer.append(columns.leftCols(2));
    writer.append(columns.middleCols(2, 0));
    writer.append(columns.rightCols(5));
    CHECK(writer.samples() == 7);
    CHECK(writer.features() == 6);
    writer.commit();
    const NpyReader<Scalar> reader(path);
    CHECK(reader.shape().size() == 1 + sample_shape.size());
    CHECK(reader.features() == 6);
    CHECK(reader.read() == columns);
    CHECK(reader.read(3, 2) == columns.middleCols(3, 2));
    CHECK(reader.read(7, 0).cols() == 0);
    CHECK(
        contains(error_of([&] { reader.read(3, 5); }), "expected a range within 7 samples, found 5 from 3"));
    CHECK_THROWS_AS(reader.read(-1, 1), Error);
    CHECK_THROWS_AS(reader.read(1, -1), Error);
  }
  NpyWriter<Scalar> scalars(path, {});
  scalars.append(columns.reshaped(1, 42));
  scalars.commit();
  CHECK(NpyReader<Scalar>(path).shape() == std::vector<Index>{42});
  CHECK(read_npy<Scalar>(path) == columns.reshaped(1, 42));
}

TEST_CASE("a file that is written in two runs is that of one") {
  const TemporaryFolder folder;
  const auto columns = counting<float>(6, 7);
  for (const auto& sample_shape : {std::vector<Index>{6}, {2, 3}}) {
    { NpyWriter<float>(folder / "a.npy", sample_shape, 0).append(columns.leftCols(5)); }
    CHECK(!std::filesystem::exists(folder / "a.npy"));
    NpyWriter<float> rest(folder / "a.npy", sample_shape, 4);
    CHECK(rest.samples() == 4);
    rest.append(columns.rightCols(3));
    rest.commit();
    NpyWriter<float> whole(folder / "b.npy", sample_shape);
    whole.append(columns);
    whole.commit();
    CHECK(read_bytes(folder / "a.npy") == read_bytes(folder / "b.npy"));
    std::filesystem::remove(folder / "a.npy");
  }
  CHECK(contains(error_of([&] { NpyWriter<float>(folder / "a.npy", {6}, 4); }), "found 0"));
}

TEST_CASE("parts of a larger matrix, and sizes of zero") {
  const TemporaryFolder folder;
  const auto path = folder / "a.npy";
  const auto columns = counting<double>(6, 7);
  write_npy(path, columns.block(1, 2, 3, 4));
  CHECK(read_npy<double>(path) == columns.block(1, 2, 3, 4));
  for (const auto& [rows, cols] : {std::pair<Index, Index>{0, 5}, {5, 0}, {0, 0}}) {
    write_npy(path, Eigen::MatrixXd(rows, cols));
    const auto read = read_npy<double>(path);
    CHECK(read.rows() == rows);
    CHECK(read.cols() == cols);
  }
}

TEST_CASE("columns of another size are refused, and an unfinished file never appears") {
  const TemporaryFolder folder;
  const auto path = folder / "a.npy";
  {
    NpyWriter<double> writer(path, {6});
    CHECK(contains(error_of([&] { writer.append(Eigen::MatrixXd::Zero(5, 1)); }),
                   path.string() + ": expected columns of 6 numbers, found 5"));
  }
  CHECK(!std::filesystem::exists(path));
  CHECK_THROWS_AS(NpyWriter<double>(path, {1, 2, 3, 4}), Error);
}

TEST_CASE("every spelling that Python reads") {
  const TemporaryFolder folder;
  const auto path = folder / "a.npy";
  for (const char version : {'\1', '\2', '\3'})
    for (const char* dictionary :
         {"{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }",
          "{\"shape\":(2,),\"fortran_order\":False,\"descr\":\"<f4\"}",
          "  { 'fortran_order' : False ,'shape' : ( 2 , 1 ) , 'descr' : '<f4' }  "}) {
      write_bytes(path, npy(version, dictionary, eight_bytes));
      CHECK(read_npy<float>(path) == Eigen::RowVector2f(1, 2));
    }
}

TEST_CASE("malformed files are refused with what is wrong") {
  const TemporaryFolder folder;
  const auto path = folder / "a.npy";
  const auto error = [&](const std::string& bytes) {
    write_bytes(path, bytes);
    const std::string message = error_of([&] { read_npy<float>(path); });
    CHECK(message.starts_with(path.string() + ": "));
    return message;
  };
  const auto dictionary_error = [&](const std::string& dictionary) {
    return error(npy(1, dictionary, eight_bytes));
  };
  const auto shape_error = [&](const std::string& shape) {
    return dictionary_error("{'descr': '<f4', 'fortran_order': False, 'shape': " + shape + ", }");
  };
  CHECK(contains(dictionary_error("{'descr': '<f\n8\x1b[31m', 'fortran_order': False, 'shape': (2,), }"),
                 "expected printable characters in the .npy header, found byte 10"));
  const std::string valid = npy(1, "{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }", eight_bytes);

  CHECK(contains(error("not NumPy at all"), "expected a NumPy .npy file"));
  CHECK(error("abc") == path.string() + ": expected a NumPy .npy file, found a file of 3 bytes");
  std::string other = valid;
  other[6] = 4;
  CHECK(contains(error(other), "expected .npy format 1.0, 2.0 or 3.0, found 4.0"));
  other[6] = 1, other[7] = 1;
  CHECK(contains(error(other), "found 1.1"));
  other = valid;
  other[8] = '\xff';
  CHECK(contains(error(other), "bytes at offset 10"));
  other[9] = '\xff';
  CHECK(contains(error(other), "at most 10000 bytes"));
  CHECK(contains(error("\x93NUMPY" + std::string("\x02\0\xff\xff\xff\xff{}", 8)),
                 "at most 10000 bytes, found 4294967295"));

  CHECK(contains(dictionary_error("{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }"),
                 "expected dtype <f4, found <f8"));
  CHECK(contains(dictionary_error("{'descr': '>f4', 'fortran_order': False, 'shape': (2,), }"), "found >f4"));
  CHECK(contains(dictionary_error("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (2,), }"),
                 "quoted string"));
  CHECK(contains(dictionary_error("{'descr': '<f4', 'fortran_order': True, 'shape': (2,), }"),
                 "found Fortran order"));
  CHECK(contains(dictionary_error("{'descr': '<f4', 'fortran_order': 0, 'shape': (2,), }"), "True or False"));
  CHECK(contains(dictionary_error("{'descr': '<f4', 'shape': (2,), }"), "lacks one"));
  CHECK(contains(dictionary_error("{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (2,)}"),
                 "each once"));
  CHECK(contains(dictionary_error("{'descr': '<f4', 'fortran_order': False, 'shape': (2,), 'more': '' }"),
                 "found more"));
  CHECK(contains(dictionary_error("{'descr': '<f4', 'fortran_order': False, 'shape': (2,)} x"),
                 "to end after }"));
  CHECK(contains(dictionary_error("{'descr': '<f4', 'fortran_order': False, 'shape': (2,)"), "expected ','"));
  CHECK(contains(dictionary_error(""), "expected '{' in the .npy header, found its end"));

  CHECK(contains(shape_error("()"), "expected 1 to 4 dimensions, found 0"));
  CHECK(contains(shape_error("(1, 2, 1, 1, 1)"), "found 5"));
  CHECK(contains(shape_error("2"), "expected '('"));
  CHECK(contains(shape_error("(-2,)"), "expected a number in the shape"));
  CHECK(contains(shape_error("(3,)"), "expected 12 bytes of data, as its shape says, found 8"));
  CHECK(contains(shape_error("(1,)"), "expected 4 bytes of data, as its shape says, found 8"));
  CHECK(contains(shape_error("(0, 99999999999, 99999999999)"), "sizes below 2^63"));
  CHECK(contains(shape_error("(4611686018427387906,)"), "sizes below 2^63"));
  CHECK(contains(shape_error("(99999999999999999999,)"), "extents below 2^63"));
  CHECK(contains(shape_error("(250000000000,)"), "expected 1000000000000 bytes of data"));

  check_other_lengths_refused(path, valid, [](const auto& p) { read_npy<float>(p); });
  const int refused = check_changed_bytes(path, valid, [](const auto& p) { read_npy<float>(p); });
  CHECK(refused > 400);  // not those in the numbers and a few in blanks
}

TEST_CASE("a path that is not a file") {
  const TemporaryFolder folder;
  const auto missing = folder / "missing.npy";
  CHECK(contains(error_of([&] { read_npy<float>(missing); }),
                 missing.string() + ": cannot read: No such file"));
  CHECK(contains(error_of([&] { read_npy<float>(folder / ""); }), "expected a regular file"));
  CHECK(contains(error_of([&] { read_npy<float>("/dev/zero"); }), "/dev/zero: expected a regular file"));
}

TEST_CASE("samples of no possible shape are refused") {
  const TemporaryFolder folder;
  const auto path = folder / "a.npy";
  for (const std::vector<Eigen::Index>& shape :
       {std::vector<Eigen::Index>{-3}, {4, -1}, {Eigen::Index{1} << 31}, {1, 1, 1, 1}})
    CHECK(contains(error_of([&] { NpyWriter<float>(path, shape); }), path.string() + ": expected "));
  CHECK(!std::filesystem::exists(AtomicFile::partial(path)));
}
