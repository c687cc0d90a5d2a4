#include "io_reseal.hpp"
#include "io_support.hpp"

#include <cstring>
#include <limits>

#include <rbres/io/cropped_network.hpp>
#include <rbres/io/export_header.hpp>
#include <rbres/io/model.hpp>
#include <rbres/nn/residual_network.hpp>

using namespace rbres;

namespace {

using Small = Network<
    float, Sequential<Linear<3, 5>, Tanh, Residual<Linear<5, 4>, Relu, Dropout, Linear<4, 5>>, Linear<5, 2>>>;

struct Doubling {
  static constexpr std::string_view name = "mine::Doubling";
  template <class T>
  static T value(const T& x) {
    return x + x;
  }
  template <class T>
  static T slope(const T&) {
    return T{} + 2;
  }
};

/// Layers counted as PyTorch counts them, numbers row by row.
struct Tensors {
  Eigen::Matrix<float, 5, 3, Eigen::RowMajor> first = decltype(first)::Random();
  Eigen::Matrix<float, 4, 5, Eigen::RowMajor> inner = decltype(inner)::Random();
  Eigen::Matrix<float, 5, 4, Eigen::RowMajor> outer = decltype(outer)::Random();
  Eigen::Matrix<float, 2, 5, Eigen::RowMajor> last = decltype(last)::Random();
  Eigen::Vector<float, 5> first_bias = decltype(first_bias)::Random(),
                          outer_bias = decltype(outer_bias)::Random();
  Eigen::Vector<float, 4> inner_bias = decltype(inner_bias)::Random();
  Eigen::Vector<float, 2> last_bias = decltype(last_bias)::Random();

  void add_to(SafetensorsWriter& file) const {
    file.add("0.weight", {5, 3}, first.data());
    file.add("0.bias", {5}, first_bias.data());
    file.add("2.0.weight", {4, 5}, inner.data());
    file.add("2.0.bias", {4}, inner_bias.data());
    file.add("2.3.weight", {5, 4}, outer.data());
    file.add("2.3.bias", {5}, outer_bias.data());
    file.add("3.weight", {2, 5}, last.data());
    file.add("3.bias", {2}, last_bias.data());
  }
  Eigen::Vector2f forward(const Eigen::Vector3f& x) const {
    const Eigen::VectorXf a = (first * x + first_bias).array().tanh();
    return last * (a + outer * (inner * a + inner_bias).cwiseMax(0.0f) + outer_bias) + last_bias;
  }
};

template <class Model>
bool same_bits(const Model& a, const Model& b) {
  return std::memcmp(a.parameters().data(), b.parameters().data(), a.parameters().size_bytes()) == 0;
}

/// A network with something besides: what a predictor is.
struct Scaled {
  Small network;
  float scale;
};

}  // namespace

template <>
struct rbres::ModelFormat<Scaled> {
  static void write(SafetensorsWriter& file, const Scaled& model) {
    ModelFormat<Small>::write(file, model.network);
    file.add("scale", {}, &model.scale);
  }
  static Scaled read(const SafetensorsReader& file) {
    Scaled model{ModelFormat<Small>::read(file), 0};
    file.read("scale", {}, &model.scale);
    return model;
  }
};

TEST_CASE_TEMPLATE("round trip to the bit", Model, Small, ResidualNetwork<float, 7, 20, 3, 5>,
                   ResidualNetwork<double, 7, 20, 3, 5>, ResidualNetwork<float, 7, 20, 3, 5, bfloat16>,
                   Network<double, Sequential<Linear<1, 1>, Doubling, Silu>>) {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  const Model model(42);
  save(path, model, {{"author", "me"}});
  CHECK(same_bits(load<Model>(path), model));
  const SafetensorsReader file(path);
  CHECK(file.metadata().at("author") == "me");
  CHECK(file.metadata().at("scalar") ==
        (std::is_same_v<typename Model::Scalar, float> ? "float32" : "float64"));
  std::size_t numbers = 0;
  for (const auto& [name, tensor] : file.tensors()) numbers += tensor.offsets[1] - tensor.offsets[0];
  CHECK(numbers == Model::parameter_count * sizeof(typename Model::Weight));
}

TEST_CASE("weights of half the size: a float network's file is rounded, and none is a float network's") {
  using Whole = ResidualNetwork<float, 7, 20, 3, 5>;
  using Half = ResidualNetwork<float, 7, 20, 3, 5, bfloat16>;
  const TemporaryFolder folder;
  const Whole whole(42);
  save(folder / "whole", whole);
  const Half half = load<Half>(folder / "whole");
  CHECK(same_bits(half, Half(whole)));
  save(folder / "half", half);
  const SafetensorsReader file(folder / "half");
  CHECK(file.metadata().at("weights") == "bfloat16");
  CHECK(file.tensors().at("0.weight").dtype == "BF16");
  CHECK(contains(error_of([&] { load<Whole>(folder / "half"); }),
                 "half: tensor '0.weight': expected dtype F32, found BF16"));
  CHECK(contains(error_of([&] { load<ResidualNetwork<float, 7, 20, 2, 5, bfloat16>>(folder / "half"); }),
                 "metadata 'architecture'"));
  CHECK(contains(error_of([&] { load<ResidualNetwork<float, 7, 20, 2, 5, bfloat16>>(folder / "whole"); }),
                 "metadata 'architecture'"));

  Half broken = half;
  broken.parameters()[0] = bfloat16(std::numeric_limits<float>::infinity());
  CHECK(contains(error_of([&] { save(folder / "broken", broken); }), "expected finite numbers, found inf"));
  CHECK(contains(error_of([&] { export_header(broken, folder / "broken.hpp"); }), "expected finite numbers"));

  SafetensorsWriter torch;  // as PyTorch saves a module after .to(torch.bfloat16)
  detail::add_parameters<Half>(torch, "", half.parameters().data());
  torch.write(folder / "torch");
  CHECK(same_bits(load<Half>(folder / "torch", Digest::optional), half));
}

TEST_CASE("names, shapes and order are PyTorch's") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  const Tensors tensors;
  SafetensorsWriter writer;
  tensors.add_to(writer);
  writer.metadata["format"] = "pt";
  writer.write(path);
  CHECK(contains(error_of([&] { load<Small>(path); }),
                 path.string() +
                     ": expected a SHA-256 digest of the file (metadata 'sha256'), found none: "
                     "another program wrote it; load(path, Digest::optional) takes it unchecked"));
  const auto model = load<Small>(path, Digest::optional);
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector3f x = Eigen::Vector3f::Random();
    CHECK((model.forward(x) - tensors.forward(x)).norm() < 1e-5f);
  }
  save(path, model);
  const SafetensorsReader file(path);
  CHECK(file.tensors().size() == 8);
  auto inner = tensors.inner;
  file.read("2.0.weight", {4, 5}, inner.setZero().data());
  CHECK(inner == tensors.inner);
  CHECK(
      file.metadata().at("architecture") ==
      "rbres::Sequential<rbres::Linear<3, 5>, rbres::Tanh, rbres::Residual<rbres::Linear<5, 4>, rbres::Relu, "
      "rbres::Dropout, rbres::Linear<4, 5>>, rbres::Linear<5, 2>>");
}

TEST_CASE("a cropped network's file is that of the network of these sizes") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  // Wider than a panel of weights.
  using Wide = Network<float, Sequential<Linear<7, 40>, Relu, Linear<40, 4>>>;
  using Narrow = Network<float, Sequential<Linear<3, 40>, Relu, Linear<40, 2>>>;
  const Wide wide(3);
  save(path, CroppedNetwork<Wide>{wide, 3, 2}, {{"author", "me"}});
  const auto narrow = load<Narrow>(path);
  Eigen::Vector<float, 7> x = decltype(x)::Zero();
  for (int i = 0; i < 10; ++i) {
    x.head(3).setRandom();
    CHECK((narrow.forward(x.head(3)) - wide.forward(x).head(2)).norm() < 1e-6f);
  }
  CHECK(SafetensorsReader(path).metadata().at("author") == "me");

  const auto error = [&](int inputs, int outputs) {
    return error_of([&] { save(folder / "new", CroppedNetwork<Wide>{wide, inputs, outputs}); });
  };
  CHECK(error(8, 2) == "CroppedNetwork::inputs: expected 1 to 7, found 8");
  CHECK(error(3, 0) == "CroppedNetwork::outputs: expected 1 to 4, found 0");
  CHECK(!std::filesystem::exists(folder / "new"));
}

TEST_CASE("a model of other sizes is refused with both") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  save(path, ResidualNetwork<float, 7, 20, 3, 5>(1));
  const std::string error = error_of([&] { load<ResidualNetwork<float, 7, 20, 4, 5>>(path); });
  CHECK(contains(error, path.string() + ": metadata 'architecture': expected 'rbres::Sequential"));
  CHECK(contains(error, "4 x rbres::Residual<rbres::Linear<20, 20>"));
  CHECK(contains(error, "found 'rbres::Sequential"));
  CHECK(contains(error, "3 x rbres::Residual<rbres::Linear<20, 20>"));
  CHECK(contains(error_of([&] { load<ResidualNetwork<double, 7, 20, 3, 5>>(path); }),
                 "metadata 'scalar': expected 'float64', found 'float32'"));

  SafetensorsWriter foreign;
  const Tensors tensors;
  tensors.add_to(foreign);
  CHECK_NOTHROW(foreign.write(path));
  using Wider = Network<float, Sequential<Linear<3, 6>, Tanh, Linear<6, 2>>>;
  CHECK(contains(error_of([&] { load<Wider>(path, Digest::optional); }),
                 "tensor '0.weight': expected shape [6, 3], found [5, 3]"));
  using Shorter = Network<float, Sequential<Linear<3, 5>, Tanh>>;
  CHECK(contains(error_of([&] { load<Shorter>(path, Digest::optional); }),
                 "expected the 2 tensors of rbres::Sequential"));
  using Longer = Network<float, Sequential<Linear<3, 5>, Tanh, Linear<5, 5>, Linear<5, 2>>>;
  CHECK(contains(error_of([&] { load<Longer>(path, Digest::optional); }), "tensor '2.weight' is missing"));
}

TEST_CASE("a changed weight is found by the digest, and without it by the probes") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  save(path, Small(42));
  std::string bytes = read_bytes(path);
  const float wrong = 3;
  std::memcpy(bytes.data() + bytes.size() - 4, &wrong, 4);
  write_bytes(path, bytes);
  for (const Digest digest : {Digest::required, Digest::optional})  // one that is there is always checked
    CHECK(
        contains(error_of([&] { load<Small>(path, digest); }), path.string() + ": SHA-256 digest: expected"));
  write_bytes(path, resealed(bytes));
  CHECK(contains(error_of([&] { load<Small>(path); }),
                 "outputs for the stored inputs: expected an error of at most"));
}

TEST_CASE("numbers that are not finite are neither saved nor loaded") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  Small model(42);
  save(path, model);
  std::string bytes = read_bytes(path);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(bytes.data() + bytes.size() - 4, &nan, 4);
  write_bytes(folder / "nan", resealed(bytes));
  CHECK(contains(error_of([&] { load<Small>(folder / "nan"); }), "expected finite numbers, found nan"));
  model.parameters()[0] = nan;
  CHECK(contains(error_of([&] { save(path, model); }), "expected finite numbers, found nan"));
  CHECK(same_bits(load<Small>(path), Small(42)));
}

TEST_CASE("more rides along in the same file") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  save(path, Scaled{Small(42), 2.5f}, {{"horizon", "0.1"}});
  const auto model = load<Scaled>(path);
  CHECK(same_bits(model.network, Small(42)));
  CHECK(model.scale == 2.5f);
  CHECK(same_bits(load<Small>(path), Small(42)));
  save(path, Small(42));
  CHECK(contains(error_of([&] { load<Scaled>(path); }), "tensor 'scale' is missing"));
  CHECK(contains(error_of([&] { save(path, Small(42), {{"scalar", "mine"}}); }), "found 'scalar'"));
}

TEST_CASE("malformed model files are refused") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  using Tiny = Network<float, Sequential<Linear<1, 2>, Relu>>;
  save(path, Tiny(42));
  const std::string valid = read_bytes(path);
  const auto replaced = [&](const std::string& from, const std::string& to) {
    REQUIRE(from.size() == to.size());
    std::string bytes = valid;
    bytes.replace(bytes.find(from), from.size(), to);
    write_bytes(path, bytes);
    CHECK(contains(error_of([&] { load<Tiny>(path); }), path.string() + ": SHA-256 digest"));
    write_bytes(path, resealed(bytes));
    return error_of([&] { load<Tiny>(path); });
  };
  CHECK(contains(replaced("\"probe_inputs", "\"probe_in_uts"),
                 "metadata 'probe_inputs': expected 3 finite numbers, found none"));
  const std::size_t at = valid.find("probe_inputs\":\"") + 15;
  CHECK(contains(replaced(valid.substr(at, 3), "x.0"), "metadata 'probe_inputs': expected 3 finite numbers"));
  CHECK(contains(replaced(valid.substr(at, 3), "nan"), "metadata 'probe_inputs': expected 3 finite numbers"));
  CHECK(contains(replaced(valid.substr(at, 5), "0 0 0"),
                 "metadata 'probe_inputs': expected 3 finite numbers, found more"));
  CHECK(contains(replaced("float32", "float64"), "expected 'float32', found 'float64'"));
  const auto read = [](const auto& p) { load<Tiny>(p); };
  check_other_lengths_refused(path, valid, read);
  // With the digest all are refused, but for those that the digest's own place does not see: there are none.
  CHECK(check_changed_bytes(path, valid, read) == static_cast<int>(9 * valid.size()));
  CHECK(check_changed_bytes(path, valid, read, resealed) > 3000);
}

TEST_CASE("a model of rbres from before digests is refused with what it is, and loads on request") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  SafetensorsWriter file;
  const Small model(42);
  ModelFormat<Small>::write(file, model);
  file.write(path);
  CHECK(error_of([&] { load<Small>(path); }) ==
        path.string() +
            ": expected a SHA-256 digest of the file (metadata 'sha256'), found none: rbres 0.1.0 "
            "before digests wrote it; load(path, Digest::optional) takes it unchecked");
  CHECK(same_bits(load<Small>(path, Digest::optional), model));
}

TEST_CASE("one's own metadata can be required, and the refusal says both values") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  save(path, Small(42), {{"world", "room"}, {"unit", "m"}});
  const SafetensorsReader file(path);
  CHECK(error_of([&] { require_metadata(file, {{"world", "room"}, {"unit", "m"}}); }) == "");
  CHECK(error_of([&] { require_metadata(file, network_metadata<Small>()); }) == "");
  CHECK(error_of([&] {
          require_metadata(file, {{"world", "free"}});
        }) == path.string() + ": metadata 'world': expected 'free', found 'room'");
  CHECK(error_of([&] {
          require_metadata(file, {{"made", "today"}});
        }) == path.string() + ": metadata 'made': expected 'today', found none");
}

TEST_CASE("the digest is that of the bytes with zeros in its place") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  save(path, Small(42), {{"note", R"("sha256":")" + std::string(64, 'a') + R"(")"}, {"also", "sha256"}});
  const std::string bytes = read_bytes(path);
  CHECK(resealed(bytes) == bytes);
  CHECK(same_bits(load<Small>(path), Small(42)));
  std::string changed = bytes;
  changed[changed.find(R"(sha256":")" + SafetensorsReader(path).metadata().at("sha256")) + 9] = 'x';
  write_bytes(path, changed);
  CHECK(contains(error_of([&] { load<Small>(path); }), "SHA-256 digest"));
  for (const char* digest : {"", "abc"}) {
    SafetensorsWriter file;
    const float one = 1;
    file.add("a", {}, &one);
    file.metadata["sha256"] = digest;
    CHECK(contains(error_of([&] { file.write(path); }), "found 'sha256'"));
    CHECK(contains(error_of([&] { file.write_with_digest(path); }), "found 'sha256'"));
  }
  std::string foreign = R"({"__metadata__":{"sha256":"abc"}})";
  write_bytes(path, std::string({static_cast<char>(foreign.size()), 0, 0, 0, 0, 0, 0, 0}) + foreign);
  CHECK(contains(error_of([&] { SafetensorsReader{path}; }), "expected a digest of 64 digits"));
}

TEST_CASE("what cannot be exported as a header is refused") {
  const TemporaryFolder folder;
  const auto path = folder / "model.hpp";
  Small model(42);
  for (const char* name : {"",         "3d",     "a-b",  "a::b",  "a b",  "class", "int",   "namespace",
                           "co_await", "xor_eq", "main", "linux", "unix", "std",   "std23", "rbres",
                           "_model",   "_X",     "a__b", "NULL",  "M_PI", "errno"})
    CHECK(contains(error_of([&] { export_header(model, path, name); }),
                   "expected a name of letters, digits and _"));
  model.parameters()[0] = std::numeric_limits<float>::infinity();
  CHECK(contains(error_of([&] { export_header(model, path); }),
                 path.string() + ": tensor '0.weight': expected finite"));
  CHECK(!std::filesystem::exists(path));
}
