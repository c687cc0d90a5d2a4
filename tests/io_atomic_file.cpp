#include "io_file_size_limit.hpp"
#include "io_support.hpp"

#include <rbres/io/atomic_file.hpp>

using rbres::AtomicFile;

namespace {

void write(const std::filesystem::path& path, const std::string& bytes) {
  AtomicFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

}  // namespace

TEST_CASE("the file appears with commit, and nothing else stays") {
  const TemporaryFolder folder;
  const auto path = folder / "data";
  {
    AtomicFile file(path);
    file.write("hello world", 11);
    file.write_at(6, "W", 1);
    file.write("!", 1);
    CHECK(!std::filesystem::exists(path));
    file.commit();
    CHECK(read_bytes(path) == "hello World!");
  }
  write(path, "new");
  CHECK(read_bytes(path) == "new");
  CHECK(!std::filesystem::exists(folder / "data.partial"));
}

TEST_CASE("without commit the old file stays") {
  const TemporaryFolder folder;
  const auto path = folder / "data";
  write(path, "old");
  {
    AtomicFile file(path);
    file.write("new", 3);
  }
  CHECK(read_bytes(path) == "old");
  CHECK(!std::filesystem::exists(folder / "data.partial"));
}

TEST_CASE("a partial file left by a killed process is overwritten, not appended to") {
  const TemporaryFolder folder;
  write_bytes(folder / "data.partial", std::string(100, 'x'));
  write(folder / "data", "new");
  CHECK(read_bytes(folder / "data") == "new");
}

TEST_CASE("a partial file that is to go on does, after the bytes that count") {
  const TemporaryFolder folder;
  const auto path = folder / "data";
  {
    AtomicFile file(path, 0);
    file.write("hello world", 11);
    file.flush();
  }
  CHECK(read_bytes(folder / "data.partial") == "hello world");
  CHECK(contains(error_of([&] { AtomicFile file(path, 12); }),
                 path.string() + ".partial: expected at least 12 bytes, found 11"));
  AtomicFile file(path, 6);
  file.write("you", 3);
  file.commit();
  CHECK(read_bytes(path) == "hello you");
  CHECK(!std::filesystem::exists(folder / "data.partial"));
}

TEST_CASE("a full disk is an Error that names the path, and the old file survives") {
  const TemporaryFolder folder;
  const auto path = folder / "data";
  write(path, "old");
  std::string error;
  {
    const FileSizeLimit limit(1000);
    error = error_of([&] { write(path, std::string(5000, 'x')); });
  }
  CHECK(contains(error, path.string() + ": cannot write: "));
  CHECK(read_bytes(path) == "old");
  CHECK(!std::filesystem::exists(folder / "data.partial"));
}

TEST_CASE("paths that cannot be written are Errors that name the path") {
  const TemporaryFolder folder;
  write_bytes(folder / "file", "x");
  for (const auto& path :
       {folder / "missing/data", folder / "file/data", folder / "", std::filesystem::path("/dev/full")}) {
    CAPTURE(path);
    CHECK(contains(error_of([&] { write(path, "x"); }), path.string() + ": "));
  }
  CHECK(std::filesystem::is_character_file("/dev/full"));
}

TEST_CASE("two writers of one path do not mix") {
  const TemporaryFolder folder;
  const auto path = folder / "data";
  AtomicFile first(path);
  first.write("first", 5);
  CHECK(
      contains(error_of([&] { AtomicFile second(path); }), path.string() + ": cannot write: another writer"));
  first.commit();
  CHECK(read_bytes(path) == "first");
  write(path, "second");
  CHECK(read_bytes(path) == "second");
}
