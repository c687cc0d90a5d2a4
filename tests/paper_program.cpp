// rbres_paper from outside: two of them do not work in one folder.
#include "program_support.hpp"

#include <rbres/io/folder_lock.hpp>

TEST_CASE("a folder that another process works in is refused") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder / "results/parts");
  std::filesystem::create_directories(folder / "results/models");
  const rbres::FolderLock lock(folder / "results", "works here");
  CHECK(contains(refusal(folder, RBRES_PAPER, "--quick --out results"),
                 "results: another process works in this folder"));
}

TEST_CASE("a folder of something else, and a file that cannot be written, are refused at once") {
  const TemporaryFolder folder;
  std::filesystem::create_directories(folder / "mine");
  std::ofstream(folder / "mine/notes.txt") << "my own";
  CHECK(contains(refusal(folder, RBRES_PAPER, "--quick --out mine"),
                 "mine: expected an empty folder or one of this program's results, found another"));
  CHECK(contains(refusal(folder, RBRES_PAPER, "--quick --out new --json none/file.json"), "none/file.json"));
  CHECK(contains(refusal(folder, RBRES_PAPER, "--quick --out new --json mine"),
                 "expected a regular file to replace"));
  CHECK_FALSE(std::filesystem::exists(folder / "mine/parts"));
  CHECK_FALSE(std::filesystem::exists(folder / "new"));
}

TEST_CASE("a lock holds as long as it lives, and no folder that is not there") {
  const TemporaryFolder folder;
  const auto error = [&](const char* name) {
    return error_of([&] { rbres::FolderLock(folder / name, "is here"); });
  };
  {
    const rbres::FolderLock lock(folder / "", "is here");
    CHECK(error("") == (folder / "").string() + ": another process is here");
  }
  CHECK(error("") == "");
  CHECK(contains(error("none"), "none: cannot read: "));
}
