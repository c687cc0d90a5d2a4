// Contact laws as files.
#include <rbres/io/contact_law.hpp>

#include <algorithm>

#include "io_support.hpp"

using namespace rbres;

namespace {

using Law = ContactLaw<8, 2>;

Law some_law() {
  Law law;
  law.network = Law::Network(3);
  for (int i = 0; i < law.input.mean.size(); ++i) {
    law.input.mean[i] = 0.1f * static_cast<float>(i) - 0.3f;
    law.input.deviation[i] = 0.5f + 0.1f * static_cast<float>(i);
  }
  law.scales = {.frame_time = 1.0 / 148, .speed = 0.7, .margin = 1e-3 / 3};
  return law;
}

}  // namespace

TEST_CASE("a contact law is read as it was written, frame time and all") {
  const TemporaryFolder folder;
  const Law law = some_law();
  save(folder / "law.safetensors", law, {{"made_of", "nothing"}});
  const Law read = load<Law>(folder / "law.safetensors");
  CHECK(std::ranges::equal(read.network.parameters(), law.network.parameters()));
  CHECK(read.input.mean == law.input.mean);
  CHECK(read.input.deviation == law.input.deviation);
  CHECK(read.scales.frame_time == law.scales.frame_time);
  CHECK(read.scales.speed == law.scales.speed);
  CHECK(read.scales.margin == law.scales.margin);
  CHECK(read.scales.moment == ContactMoment::halfway);
  CHECK(!SafetensorsReader(folder / "law.safetensors").metadata().contains("moment"));
}

TEST_CASE("a contact law of impacts is read as one, and another moment is refused") {
  const TemporaryFolder folder;
  const auto path = folder / "law.safetensors";
  Law law = some_law();
  law.scales.moment = ContactMoment::impact;
  save(path, law);
  CHECK(load<Law>(path).scales.moment == ContactMoment::impact);
  save(path, some_law(), {{"moment", "later"}});
  CHECK(contains(error_of([&] { load<Law>(path); }),
                 "metadata 'moment': expected halfway or impact, found later"));
}

TEST_CASE("a hybrid is read as it was written, and is no contact law") {
  const TemporaryFolder folder;
  HybridLaw<8, 2> law;
  static_cast<Law&>(law) = some_law();
  law.weight = 0.75;
  save(folder / "law.safetensors", law);
  const auto read = load<HybridLaw<8, 2>>(folder / "law.safetensors");
  CHECK(std::ranges::equal(read.network.parameters(), law.network.parameters()));
  CHECK(read.input.mean == law.input.mean);
  CHECK(read.scales.margin == law.scales.margin);
  CHECK(read.weight == 0.75);
  CHECK(contains(error_of([&] { load<Law>(folder / "law.safetensors"); }), "metadata 'contact_law'"));
  law.weight = NAN;
  CHECK(error_of([&] {
          save(folder / "law.safetensors", law);
        }).starts_with("weight of a saved hybrid: expected numbers from "));
}

TEST_CASE("laws of half-size weights: those of float files are rounded, and none is a float law's") {
  const TemporaryFolder folder;
  HybridLaw<8, 2> whole;
  static_cast<Law&>(whole) = some_law();
  whole.weight = 0.75;
  whole.scales.moment = ContactMoment::impact;
  save(folder / "whole", whole);
  using Half = HybridLaw<8, 2, float, bfloat16>;
  const auto half = with_weights<bfloat16>(whole);
  static_assert(std::same_as<decltype(half), const Half>);
  const auto same = [&](const Half& law) {
    return std::ranges::equal(law.network.parameters(), half.network.parameters()) &&
           law.input.mean == whole.input.mean && law.input.deviation == whole.input.deviation &&
           law.scales.margin == whole.scales.margin && law.scales.moment == whole.scales.moment &&
           law.weight == whole.weight;
  };
  CHECK(same(half));
  const auto halves = Half::Network::tensors(), wholes = HybridLaw<8, 2>::Network::tensors();
  for (std::size_t i = 0; i < wholes.size(); ++i)
    CHECK(float(half.network.parameters()[halves[i].index(7 % wholes[i].rows)]) ==
          float(bfloat16(std::as_const(whole.network).parameters()[wholes[i].index(7 % wholes[i].rows)])));
  CHECK(same(load<Half>(folder / "whole")));
  save(folder / "half", half);
  CHECK(10 * std::filesystem::file_size(folder / "half") < 7 * std::filesystem::file_size(folder / "whole"));
  CHECK(same(load<Half>(folder / "half")));
  CHECK(contains(error_of([&] { load<HybridLaw<8, 2>>(folder / "half"); }),
                 "half: tensor '0.0.weight': expected dtype F32, found BF16"));
  CHECK(contains(error_of([&] { load<HybridLaw<8, 3, float, bfloat16>>(folder / "half"); }),
                 "metadata 'hybrid_law': expected 'width 8, rounds 3"));
  const auto back = with_weights<float>(half);
  CHECK(std::ranges::equal(with_weights<bfloat16>(back).network.parameters(), half.network.parameters()));
}

TEST_CASE("files of other laws and laws that make no sense are refused") {
  const TemporaryFolder folder;
  const auto path = folder / "law.safetensors";
  save(path, some_law());
  CHECK(error_of([&] { load<ContactLaw<8, 3>>(path); }) ==
        path.string() +
            ": metadata 'contact_law': expected 'width 8, rounds 3, features 20, outputs 5', found "
            "'width 8, rounds 2, features 20, outputs 5'");
  CHECK(error_of([&] { load<ContactLaw<8, 2, double>>(path); }).find("float64") != std::string::npos);
  auto bytes = read_bytes(path);
  bytes[bytes.size() / 2] ^= 1;
  write_bytes(path, bytes);
  CHECK(error_of([&] { load<Law>(path); }).find("digest") != std::string::npos);

  Law law = some_law();
  law.scales.frame_time = 0;
  CHECK(error_of([&] {
          save(path, law);
        }).starts_with("scales of a saved contact law: expected numbers from "));
  law = some_law();
  law.network.parameters()[0] = NAN;
  CHECK(error_of([&] { save(path, law); }).starts_with("weights of a contact law"));
  CHECK(read_bytes(path) == bytes);
}
