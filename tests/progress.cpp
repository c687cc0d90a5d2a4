// How programs say how far they are: a line that is printed over on a terminal, whole lines elsewhere.
#include "../examples/common/progress.hpp"

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include "io_support.hpp"

namespace {

void work(std::FILE* to) {
  ProgressLine line(to);
  for (int i = 0; i <= 1000; ++i)
    line.print(i / 1000.0, i < 1000 ? std::to_string(1000 - i) + " left" : "all");
  line.end();
}

}  // namespace

TEST_CASE("a log gets whole lines, one for each hundredth of the work") {
  const TemporaryFolder folder;
  std::FILE* file = std::fopen((folder / "log").c_str(), "w");
  REQUIRE(file != nullptr);
  work(file);
  std::fclose(file);
  const std::string log = read_bytes(folder / "log");
  CHECK(!contains(log, "\r"));
  CHECK(std::count(log.begin(), log.end(), '\n') == 101);
  CHECK(log.starts_with("  1000 left\n  990 left\n"));
  CHECK(log.ends_with("\n  10 left\n  all\n"));
}

TEST_CASE("a line that stays stands on its own in a log") {
  const TemporaryFolder folder;
  std::FILE* file = std::fopen((folder / "log").c_str(), "w");
  REQUIRE(file != nullptr);
  ProgressLine line(file);
  line.print(0.5, "half of it");
  line.say("a part is done");
  line.print(1, "all of it");
  line.end();
  std::fclose(file);
  CHECK(read_bytes(folder / "log") == "  half of it\n  a part is done\n  all of it\n");
}

TEST_CASE("a terminal gets one line, without the rest of a longer one") {
  const int master = ::posix_openpt(O_RDWR | O_NOCTTY);
  REQUIRE(master >= 0);
  REQUIRE(::grantpt(master) == 0);
  REQUIRE(::unlockpt(master) == 0);
  std::FILE* terminal = std::fopen(::ptsname(master), "w");
  REQUIRE(terminal != nullptr);
  ProgressLine line(terminal);
  line.print(0.001, "1000 left");
  line.say("done");
  line.print(0.002, "9 left");
  line.end();
  std::fputs("end", terminal);
  std::fflush(terminal);
  std::string shown;
  while (!shown.ends_with("end")) {  // a read may bring less than was written
    char bytes[200];
    const ssize_t count = ::read(master, bytes, sizeof bytes);
    REQUIRE(count > 0);
    shown.append(bytes, static_cast<std::size_t>(count));
  }
  std::fclose(terminal);
  ::close(master);
  CHECK(shown.starts_with("\r  1000 left \r  done     \r\n\r  9 left    "));
  CHECK(std::count(shown.begin(), shown.end(), '\n') == 2);
}
