// Checks this build of rbres against closed forms, conservation laws and published reference cases.
#include <cstring>

#include "common/help.hpp"
#include "validate/free_motion.hpp"
#include "validate/impacts.hpp"
#include "validate/invariants.hpp"
#include "validate/rest.hpp"
#include "validate/scenes.hpp"

namespace {

constexpr const char* usage =
    "usage: rbres_validate [--json [FILE]] [--help]\n"
    "Runs every check and prints a table: what was measured, the bound it has to keep, and the reference.\n"
    "  --json [FILE]  the same as a JSON array, to FILE, or to standard output in place of the table\n"
    "Exit status: 0 all pass, 1 a check fails, 2 the command line or FILE is at fault.\n";

}  // namespace

int main(int argc, char** argv) {
  bool json = false;
  const char* file = nullptr;
  if (asks_for_help(argc, argv)) return print_help(argv, usage);
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--json") != 0) return refuse_argument(argv, argv[i]);
    json = true;
    if (i + 1 < argc && argv[i + 1][0] != '-') file = argv[++i];
  }
  std::FILE* out = stdout;
  if (file != nullptr && (out = std::fopen(file, "w")) == nullptr) {
    std::fprintf(stderr, "rbres_validate: cannot write %s\n", file);
    return 2;
  }

  validate::Rows rows;
  validate::free_motion(rows);
  validate::impacts(rows);
  validate::rest(rows);
  validate::scenes(rows);
  validate::invariants(rows);

  if (!json || file != nullptr) validate::print_table(rows, stdout);
  if (json) validate::print_json(rows, out);
  if (file != nullptr && std::fclose(out) != 0) {
    std::fprintf(stderr, "rbres_validate: cannot write %s\n", file);
    return 2;
  }
  for (const auto& row : rows) {
    if (!row.pass()) return 1;
  }
  return finish(argv);
}
