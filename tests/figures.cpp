// Figures by gnuplot: their scripts draw without a warning where no locale is set, as on a bare system.
#include "../examples/figures/gnuplot.hpp"
#include "io_support.hpp"

#include <cstdlib>

TEST_CASE("every figure draws in the C locale without a warning") {
  const TemporaryFolder folder;
  const auto figure = [&](const char* name) {
    return figures::Figure{folder / "", name, "A title", "time, s", "mean square error, m^2"};
  };
  figures::draw_curves(figure("curves"), {{"one", {1, 2, 3}, {1, 10, 100}}}, {.log_y = true});
  figures::draw_agreement(figure("agreement"), {1, 2, 3}, {1, 2, 4}, 0.5, "m/s");
  figures::draw_trade_off(figure("trade_off"), {{"some", {"a", "b"}, {1, 10}, {1, 100}, true}});
  figures::draw_quartiles(figure("quartiles"), {"one", "two"}, {{"some", {{1, 2, 3}, {2, 3, 4}}}});
  for (const char* name : {"curves.gp", "agreement.gp", "trade_off.gp", "quartiles.gp"})
    for (const char c : read_bytes(folder / name)) REQUIRE(static_cast<unsigned char>(c) < 128);
  if (std::system("gnuplot --version > /dev/null 2>&1") != 0) return;
  const std::string command = "cd '" + (folder / "").string() + "' && LC_ALL=C gnuplot *.gp 2> .err";
  CHECK(std::system(command.c_str()) == 0);
  CHECK(read_bytes(folder / ".err") == "");
  CHECK(read_bytes(folder / "curves.png").substr(1, 3) == "PNG");
}

TEST_CASE("names and labels that gnuplot could not write are refused") {
  const TemporaryFolder folder;
  const figures::Figure figure{folder / "", "a", "Square metres: m²", "", ""};
  CHECK(contains(error_of([&] { figures::draw_curves(figure, {}); }),
                 "figure a: expected names and labels in ASCII, found other characters"));
  CHECK(!std::filesystem::exists(folder / "a.gp"));
}
