#pragma once

#include <rbres/io/metadata.hpp>
#include <rbres/io/model.hpp>
#include <rbres/learn/hybrid_law.hpp>

#include <string>

namespace rbres::RBRES_ABI {

namespace detail {

/// See ModelFormat<ContactLaw> and ModelFormat<HybridLaw>. Whole is the same law with its weights kept as
/// Scalar.
template <class Model, class Whole>
struct ContactLawFormat {
  /// The law must stay until the file is written.
  static void write(SafetensorsWriter& file, const Model& law) {
    using Net = typename Model::Network;
    detail::require_finite("weights of a contact law", law.network.parameters().data(), Net::block_size);
    detail::require_within("input deviation of a saved contact law", law.input.deviation, positive);
    const Scales scales = numbers(law.scales);
    detail::require_within("scales of a saved contact law", scales, positive);
    detail::add_parameters<Net>(file, "", law.network.parameters().data());
    file.metadata = metadata();
    file.metadata["input_mean"] = detail::numbers_to_text(law.input.mean);
    file.metadata["input_deviation"] = detail::numbers_to_text(law.input.deviation);
    file.metadata["frame_time"] = detail::numbers_to_text(scales.segment<1>(0));
    file.metadata["speed"] = detail::numbers_to_text(scales.segment<1>(1));
    file.metadata["margin"] = detail::numbers_to_text(scales.segment<1>(2));
    // Files of laws that look halfway are those of versions that knew nothing else.
    if (law.scales.moment != ContactMoment::halfway) file.metadata["moment"] = name(law.scales.moment);
    if constexpr (Model::corrects) {
      const Eigen::Matrix<double, 1, 1> weight(law.weight);
      detail::require_within("weight of a saved hybrid", weight, Bounds{});
      file.metadata["weight"] = detail::numbers_to_text(weight);
    }
  }

  static Model read(const SafetensorsReader& file) {
    using Net = typename Model::Network;
    if constexpr (!std::is_same_v<Model, Whole>) {
      if (!detail::keeps_parameters_as<typename Net::Weight>(file))
        return with_weights<typename Net::Weight>(ModelFormat<Whole>::read(file));
    }
    require_metadata(file, metadata());
    Model law;
    detail::read_parameters<Net>(file, "", law.network.parameters().data());
    detail::numbers_from_metadata(file, "input_mean", law.input.mean);
    detail::numbers_from_metadata(file, "input_deviation", law.input.deviation, positive);
    law.scales.frame_time = number(file, "frame_time");
    law.scales.speed = number(file, "speed");
    law.scales.margin = number(file, "margin");
    law.scales.moment = moment(file);
    if constexpr (Model::corrects) law.weight = number(file, "weight", {});
    return law;
  }

 private:
  static constexpr detail::Bounds positive{1e-30, 1e30};
  using Scales = Eigen::Vector3d;

  static Metadata metadata() {
    using Net = typename Model::Network;
    Metadata all = detail::number_metadata<Net>();
    all[Model::corrects ? "hybrid_law" : "contact_law"] =
        detail::text("width ", Net::width, ", rounds ", Net::rounds, ", features ", Net::inputs, ", outputs ",
                     Net::outputs);
    return all;
  }
  static ContactMoment moment(const SafetensorsReader& file) {
    const auto found = file.metadata().find("moment");
    if (found == file.metadata().end()) return ContactMoment::halfway;
    for (const ContactMoment m : {ContactMoment::halfway, ContactMoment::impact})
      if (found->second == name(m)) return m;
    refuse(text(file.path().string(), ": metadata 'moment'"), "halfway or impact", found->second);
  }
  static Scales numbers(const ContactScales& scales) {
    return {scales.frame_time, scales.speed, scales.margin};
  }
  static double number(const SafetensorsReader& file, const char* key, Bounds bounds = positive) {
    Eigen::Matrix<double, 1, 1> x;
    detail::numbers_from_metadata(file, key, x, bounds);
    return x[0];
  }
};

}  // namespace detail

/// A contact law's file: the tensors of its networks, "0.0.weight" and so on (part, layer), and in the
/// metadata what they are ("contact_law": width, rounds, features and outputs; "scalar"; "weights" where they
/// are kept in another type), the normalisation ("input_mean", "input_deviation") and the scales
/// ("frame_time" in s, "speed" in m/s, "margin" in m; "moment": halfway, also where it is not there, or
/// impact). A law of half-size weights is also read from the file of a float one: its numbers are then
/// rounded.
template <int Width, int Rounds, std::floating_point T, class W>
struct ModelFormat<ContactLaw<Width, Rounds, T, W>>
    : detail::ContactLawFormat<ContactLaw<Width, Rounds, T, W>, ContactLaw<Width, Rounds, T>> {};

/// The same with "hybrid_law" in the place of "contact_law", and the "weight" of the correction. The
/// materials of the analytic law are those of the bodies.
template <int Width, int Rounds, std::floating_point T, class W>
struct ModelFormat<HybridLaw<Width, Rounds, T, W>>
    : detail::ContactLawFormat<HybridLaw<Width, Rounds, T, W>, HybridLaw<Width, Rounds, T>> {};

}  // namespace rbres::RBRES_ABI
