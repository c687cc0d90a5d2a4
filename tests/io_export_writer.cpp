// io_export_writer FLOAT.hpp DOUBLE.hpp LAW.hpp HYBRID.hpp PREDICTOR.hpp HALF.hpp HALF_LAW.hpp: writes the
// headers that io_export_header.cpp compiles.
#include <rbres/io/export_contact_law.hpp>
#include <rbres/io/export_predictor.hpp>

#include "io_export_models.hpp"

int main(int argc, char** argv) {
  if (argc != 8) return 2;
  rbres::export_header(exported_float(), argv[1], "exported_f");
  rbres::export_header(exported_double(), argv[2], "exported_d");
  rbres::export_header(exported_law(), argv[3], "exported_l");
  rbres::export_header(exported_hybrid(), argv[4], "exported_h");
  rbres::export_header(exported_predictor(), argv[5], "exported_p");
  rbres::export_header(exported_half(), argv[6], "exported_s");
  rbres::export_header(exported_half_law(), argv[7], "exported_hl");
}
