#pragma once

#include <rbres/nn/layers.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

/// @file
/// What a Sequential means, worked out at compile time: a list of stages, each of them one pass over the
/// data.
namespace rbres::RBRES_ABI::detail {

inline constexpr int no_stage = -1;

/// z = W x + b, or layer norm(x), or x; y = elementwise layers(z) (+ value `skip`). Value 0 is the network's
/// input, and stage s turns value s into value s + 1. Where there is a skip there are no elementwise layers.
struct Stage {
  bool has_linear = false, has_norm = false;
  int inputs = 0, outputs = 0;
  int skip = no_stage;
  int first = 0, count = 0;  // elementwise layers, as a range of all of the network
  bool has_dropout = false;  // at most one of them
  double rate = -1;          // its own rate, if not negative
};

template <std::size_t Capacity>
struct Plan {
  std::array<Stage, Capacity> stages{};
  int stage_count = 0;
  int elementwise_count = 0;
  int size = 0;                 // of the newest value
  bool sealed = true;           // the newest value is needed as it is, by a skip or as the input
  int found = 0, expected = 0;  // the first two sizes that do not fit

  constexpr void expect(int f, int e) {
    if (f != e && found == expected) found = f, expected = e;
  }
  constexpr void push(Stage stage) {
    stages[static_cast<std::size_t>(stage_count++)] = stage;
    size = stage.outputs;
    sealed = stage.skip != no_stage;
  }
  constexpr Stage& last() { return stages[static_cast<std::size_t>(stage_count - 1)]; }
};

template <class Plan, int In, int Out>
constexpr void append(Plan& plan, Linear<In, Out>) {
  plan.expect(In, plan.size);
  plan.push({.has_linear = true, .inputs = In, .outputs = Out, .first = plan.elementwise_count});
}

template <class Plan, int Size>
constexpr void append(Plan& plan, LayerNorm<Size>) {
  plan.expect(Size, plan.size);
  plan.push({.has_norm = true, .inputs = Size, .outputs = Size, .first = plan.elementwise_count});
}

template <class Plan, Elementwise Layer>
constexpr void append(Plan& plan, Layer) {
  constexpr bool dropout = is_dropout<Layer>;
  if (plan.sealed || (dropout && plan.last().has_dropout))
    plan.push({.inputs = plan.size, .outputs = plan.size, .first = plan.elementwise_count});
  plan.last().count += 1;
  plan.last().has_dropout |= dropout;
  if (dropout) plan.last().rate = own_rate<Layer>;
  plan.elementwise_count += 1;
}

template <class Plan, class... Layers>
constexpr void append(Plan& plan, Residual<Layers...>);

template <class Plan, class... Layers>
constexpr void append(Plan& plan, Sequential<Layers...>) {
  (append(plan, Layers{}), ...);
}

template <class Plan, class... Layers>
constexpr void append(Plan& plan, Residual<Layers...>) {
  const int entry = plan.stage_count, size = plan.size;
  plan.sealed = true;
  (append(plan, Layers{}), ...);
  plan.expect(plan.size, size);
  if (plan.last().has_linear && plan.last().count == 0 && plan.last().skip == no_stage)
    plan.last().skip = entry;
  else
    plan.push({.inputs = size, .outputs = size, .skip = entry, .first = plan.elementwise_count});
  plan.sealed = true;
}

/// Size that the first layer with a size takes, 0 where there is none; and upper bound of the number of
/// stages.
template <class Layer>
struct Shape {
  static constexpr int inputs = 0;
  static constexpr std::size_t stages = 1;
  using Elementwise = std::tuple<Layer>;
};
template <int In, int Out>
struct Shape<Linear<In, Out>> {
  static constexpr int inputs = In;
  static constexpr std::size_t stages = 1;
  using Elementwise = std::tuple<>;
};
template <int Size>
struct Shape<LayerNorm<Size>> {
  static constexpr int inputs = Size;
  static constexpr std::size_t stages = 1;
  using Elementwise = std::tuple<>;
};
template <class... Layers>
struct Shape<Sequential<Layers...>> {
  static constexpr int inputs = [] {
    int first = 0;
    ((first = first != 0 ? first : Shape<Layers>::inputs), ...);
    return first;
  }();
  static constexpr std::size_t stages = (1 + ... + Shape<Layers>::stages);
  using Elementwise = decltype(std::tuple_cat(typename Shape<Layers>::Elementwise{}...));
};
template <class... Layers>
struct Shape<Residual<Layers...>> : Shape<Sequential<Layers...>> {};

template <int Found, int Expected>
struct SizesFit {
  static_assert(Found == Expected,
                "Sequential: a layer takes Found inputs, but the layer before it gives Expected outputs; or "
                "the layers in a "
                "Residual return Found outputs where x has Expected");
};

/// Elementwise layers one after the other.
template <class... Layers>
struct Chain {
  static constexpr bool empty = sizeof...(Layers) == 0;

  /// y, with `factor` in Dropout's place.
  template <class T>
  [[gnu::always_inline]] static T value(T z, [[maybe_unused]] const T& factor) {
    ((z = apply<Layers>(z, factor)), ...);
    return z;
  }
  /// The same, and dy/dz.
  template <class T>
  [[gnu::always_inline]] static T value_and_slope(T z, [[maybe_unused]] const T& factor, T& slope) {
    slope = T{} + 1;
    ((slope *= slope_of<Layers>(z, factor), z = apply<Layers>(z, factor)), ...);
    return z;
  }

 private:
  template <class Layer, class T>
  [[gnu::always_inline]] static T apply(const T& z, [[maybe_unused]] const T& factor) {
    if constexpr (is_dropout<Layer>) {
      return z * factor;
    } else {
      return Layer::value(z);
    }
  }
  template <class Layer, class T>
  [[gnu::always_inline]] static T slope_of([[maybe_unused]] const T& z, [[maybe_unused]] const T& factor) {
    if constexpr (is_dropout<Layer>) {
      return factor;
    } else {
      return Layer::slope(z);
    }
  }
};

/// A chain at inference, where dropout does nothing: without it, so that more stages share their code.
template <class Kept, class... Layers>
struct AtInference {
  using type = Kept;
};
template <class... Kept, class Layer, class... Rest>
struct AtInference<Chain<Kept...>, Layer, Rest...>
    : AtInference<std::conditional_t<is_dropout<Layer>, Chain<Kept...>, Chain<Kept..., Layer>>, Rest...> {};
template <class... Layers>
typename AtInference<Chain<>, Layers...>::type at_inference(Chain<Layers...>);

/// The elementwise layers [First, First + sizeof...(I)) of a tuple.
template <class All, int First, std::size_t... I>
Chain<std::tuple_element_t<static_cast<std::size_t>(First) + I, All>...> chain_of(std::index_sequence<I...>);

template <class Layers>
struct Compiled;

/// All of a network's sizes and places as constants.
template <class... Layers>
struct Compiled<Sequential<Layers...>> {
  using Described = Shape<Sequential<Layers...>>;
  using AllElementwise = typename Described::Elementwise;
  static_assert(Described::inputs > 0,
                "Sequential: needs at least one Linear or LayerNorm, which gives the sizes");

  static constexpr auto plan = [] {
    Plan<Described::stages> p;
    p.size = Described::inputs;
    (append(p, Layers{}), ...);
    return p;
  }();
  static constexpr SizesFit<plan.found, plan.expected> sizes_fit{};

  static constexpr int stage_count = plan.stage_count;
  static constexpr const Stage& stage(int s) { return plan.stages[static_cast<std::size_t>(s)]; }
  /// Numbers in value v.
  static constexpr int size(int v) { return v == 0 ? stage(0).inputs : stage(v - 1).outputs; }
  static constexpr int max_size = [] {
    int most = 0;
    for (int v = 0; v <= stage_count; ++v) most = std::max(most, size(v));
    return most;
  }();

  /// Whether value v is still read by stage s or a later one.
  static constexpr bool live(int v, int s) {
    bool found = v == s;
    for (int t = s; t < stage_count; ++t) found |= stage(t).skip == v;
    return found;
  }
  /// The buffer of each value at inference, as few as possible: a skip is added in place where nobody needs
  /// it later.
  static constexpr auto slots = [] {
    std::array<int, static_cast<std::size_t>(stage_count) + 1> slot{};
    for (int s = 0; s < stage_count; ++s) {
      const int skip = stage(s).skip;
      const auto at = [&slot](int v) -> int& { return slot[static_cast<std::size_t>(v)]; };
      if (skip != no_stage && skip != s && !live(skip, s + 1)) {
        at(s + 1) = at(skip);
        continue;
      }
      const auto taken = [&](int candidate) {
        for (int v = 0; v <= s; ++v)
          if (at(v) == candidate && (live(v, s))) return true;
        return false;
      };
      while (taken(at(s + 1))) ++at(s + 1);
    }
    return slot;
  }();
  static constexpr int slot_count = 1 + *std::max_element(slots.begin(), slots.end());

  template <int S>
  using ChainOfStage = decltype(chain_of<AllElementwise, stage(S).first>(
      std::make_index_sequence<static_cast<std::size_t>(stage(S).count)>{}));
  template <int S>
  using ChainAtInference = decltype(at_inference(ChainOfStage<S>{}));
};

/// The name of the layer at this place of a container.
[[gnu::cold]] inline std::string layer_name(const std::string& container, int place) {
  return container + (container.empty() ? "" : ".") + std::to_string(place);
}

/// Names of the layers with parameters, as the equivalent nn.Sequential counts them, in the order of the
/// stages.
template <int In, int Out>
void append_names(std::vector<std::string>& names, const std::string& name, Linear<In, Out>) {
  names.push_back(name);
}
template <int Size>
void append_names(std::vector<std::string>& names, const std::string& name, LayerNorm<Size>) {
  names.push_back(name);
}
template <Elementwise Layer>
void append_names(std::vector<std::string>&, const std::string&, Layer) {}
template <template <class...> class Container, class... Layers>
void append_names(std::vector<std::string>& names, const std::string& prefix, Container<Layers...>) {
  int position = 0;
  (append_names(names, layer_name(prefix, position++), Layers{}), ...);
}

}  // namespace rbres::RBRES_ABI::detail
