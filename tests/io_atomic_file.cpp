#include "io_file_size_limit.hpp"
#include "io_support.hpp"

#include <sys/stat.h>

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
  CHECK(!std::filesystem::exists(folder / "data.rbres-partial"));
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
  CHECK(!std::filesystem::exists(folder / "data.rbres-partial"));
}

TEST_CASE("a partial file left by a killed process is overwritten, not appended to") {
  const TemporaryFolder folder;
  write_bytes(folder / "data.rbres-partial", std::string(100, 'x'));
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
  CHECK(read_bytes(folder / "data.rbres-partial") == "hello world");
  CHECK(contains(error_of([&] { AtomicFile file(path, 12); }),
                 path.string() + ".rbres-partial: expected at least 12 bytes, found 11"));
  AtomicFile file(path, 6);
  file.write("you", 3);
  file.commit();
  CHECK(read_bytes(path) == "hello you");
  CHECK(!std::filesystem::exists(folder / "data.rbres-partial"));
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
  CHECK(!std::filesystem::exists(folder / "data.rbres-partial"));
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

TEST_CASE("what else stands where the partial file goes is neither followed nor touched") {
  const TemporaryFolder folder;
  const auto path = folder / "data", partial = AtomicFile::partial(path), victim = folder / "victim";
  write_bytes(victim, "someone's");
  const auto check_refused = [&](const auto& open) {
    CHECK(contains(error_of(open), path.string() + ": cannot write: " + partial.string() + " is not"));
    CHECK(std::filesystem::exists(std::filesystem::symlink_status(partial)));
    CHECK(read_bytes(victim) == "someone's");
    CHECK(!std::filesystem::exists(path));
  };
  const auto anew = [&] { AtomicFile file(path); };
  const auto go_on = [&] { AtomicFile file(path, 3); };
  std::filesystem::create_symlink(victim, partial);
  check_refused(anew);
  check_refused(go_on);
  std::filesystem::remove(partial);
  REQUIRE(::mkfifo(partial.c_str(), 0600) == 0);
  check_refused(anew);  // and does not wait for a reader
  check_refused(go_on);
  std::filesystem::remove(partial);
  std::filesystem::create_directory(partial);
  check_refused(anew);
  std::filesystem::remove(partial);
  std::filesystem::create_hard_link(victim, partial);
  check_refused(go_on);
  write(path, "ours");  // takes the name away, not the file that has another
  CHECK(read_bytes(victim) == "someone's");
  CHECK(read_bytes(path) == "ours");
  // Names that are not ours mean nothing.
  std::filesystem::create_symlink(victim, folder / "data.partial");
  write(path, "again");
  CHECK(read_bytes(victim) == "someone's");
  CHECK(read_bytes(path) == "again");
}

TEST_CASE("a replaced file keeps its permissions") {
  const TemporaryFolder folder;
  const auto path = folder / "data";
  const auto mode = [&](const std::filesystem::path& file) {
    struct stat found {};
    REQUIRE(::stat(file.c_str(), &found) == 0);
    return found.st_mode & 0777;
  };
  for (const mode_t kept : {0600u, 0640u, 0666u}) {
    write(path, "old");
    REQUIRE(::chmod(path.c_str(), kept) == 0);
    AtomicFile file(path);
    CHECK(mode(AtomicFile::partial(path)) == kept);  // from the start
    file.write("new", 3);
    file.commit();
    CHECK(mode(path) == kept);
    CHECK(read_bytes(path) == "new");
  }
}

TEST_CASE("where no file may be replaced, none is") {
  const TemporaryFolder folder;
  const auto path = folder / "data";
  {
    AtomicFile file(path);
    file.write("new", 3);
    write_bytes(path, "someone's");
    CHECK(error_of([&] { file.commit_new(); }) == path.string() + ": exists by now and would be overwritten");
  }
  CHECK(read_bytes(path) == "someone's");
  std::filesystem::remove(path);
  AtomicFile file(path);
  file.write("new", 3);
  file.commit_new();
  CHECK(read_bytes(path) == "new");
  CHECK(std::distance(std::filesystem::directory_iterator(folder / ""), {}) == 1);
}

TEST_CASE("room that is reserved is not part of the file, and a lack of it is found at once") {
  const TemporaryFolder folder;
  const auto path = folder / "data";
  {
    AtomicFile file(path);
    file.reserve(100'000);
    file.write("new", 3);
    file.commit();
  }
  CHECK(read_bytes(path) == "new");
  const FileSizeLimit limit(1000);
  AtomicFile file(path);
  CHECK(contains(error_of([&] { file.reserve(100'000); }), path.string() + ": cannot write: "));
}
