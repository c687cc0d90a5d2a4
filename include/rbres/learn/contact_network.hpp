#pragma once

#include <rbres/nn/network_parts.hpp>
#include <rbres/nn/tape.hpp>

#include <cmath>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

namespace rbres::RBRES_ABI {

/// x (1 + x / sqrt(1 + x^2)) / 2: like Silu, with an algebraic gate that costs a square root instead of an
/// exponential.
struct AlgebraicSilu {
  /// As files name it.
  static constexpr std::string_view name = "rbres::AlgebraicSilu";

  /// The function and its derivative.
  /// @{
  template <class T>
  static T value(const T& x) {
    return T(x * gate(T(x * inverse_length(x))));
  }
  template <class T>
  static T slope(const T& x) {
    const T inverse = inverse_length(x);
    return T(gate(T(x * inverse)) + detail::constant<T>(1) / 2 * x * inverse * inverse * inverse);
  }
  /// @}

 private:
  template <class T>
  static T gate(const T& x) {
    return T((detail::constant<T>(1) + x) / 2);
  }
  template <class T>
  static T inverse_length(const T& x) {
    const T squared = x * x + detail::constant<T>(1);
    if constexpr (detail::is_simd<T>) {
      return detail::constant<T>(1) / detail::root_of_lanes(squared);
    } else {
      using std::sqrt;
      return T(detail::constant<T>(1) / sqrt(squared));
    }
  }
};

namespace detail {

/// Which bodies a contact joins, for messages: an index of a body, or -1 for a fixed plane.
struct ContactEnds {
  int first, second;
  /// Each body's share of the mobility 1/m_1 + 1/m_2; that of a plane is 0.
  float first_share, second_share;
};

/// A perceptron with two hidden layers.
template <int In, int Width, int Out>
using Perceptron =
    Sequential<Linear<In, Width>, AlgebraicSilu, Linear<Width, Width>, AlgebraicSilu, Linear<Width, Out>>;

template <class T, class W, int In, int Width, int Out, class>
struct ContactParts;
template <class T, class W, int In, int Width, int Out, int... Message>
struct ContactParts<T, W, In, Width, Out, std::integer_sequence<int, Message...>> {
  template <int>
  using Update = Network<T, Perceptron<3 * Width, Width, Width>, W>;
  using type = NetworkParts<Network<T, Perceptron<In, Width, Width>, W>, Update<Message>...,
                            Network<T, Perceptron<Width, Width, Out>, W>>;
};

}  // namespace detail

/// A graph network over contacts (after Battaglia et al. 2018): every contact is encoded; in each round after
/// the first it is changed by a function of itself and of the sums, over its two bodies, of the encodings of
/// their contacts; at last it is decoded. Bodies enter through sums alone, one set of weights serves any
/// number of them, and nothing depends on their order but rounding. W is what its parameters are kept in (see
/// Network).
template <std::floating_point T, int In, int Out, int Width, int Rounds, WeightOf<T> W = T>
class ContactNetwork
    : public detail::ContactParts<T, W, In, Width, Out, std::make_integer_sequence<int, Rounds - 1>>::type {
  static_assert(Rounds >= 1, "a contact network has at least one round");
  using Base =
      typename detail::ContactParts<T, W, In, Width, Out, std::make_integer_sequence<int, Rounds - 1>>::type;
  template <int I>
  using Part = typename Base::template Part<I>;

 public:
  using Base::Base;
  /// Numbers of a contact that it is given and that it gives, of its encoding, and passes over all contacts.
  /// @{
  static constexpr int inputs = In, outputs = Out, width = Width, rounds = Rounds;
  /// @}
  /// Contacts as columns.
  using Columns = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
  /// Which bodies each contact joins.
  using Ends = std::span<const detail::ContactEnds>;

  /// Room for up to `contacts` contacts between up to `bodies` bodies, which the caller keeps.
  class Workspace {
   public:
    /// Allocates all that a pass needs.
    Workspace(Eigen::Index contacts, Eigen::Index bodies)
        : encoding(Width, contacts),
          change(Width, contacts),
          gathered(3 * Width, contacts),
          sums(Width, bodies) {}

    /// Of the pass.
    /// @{
    Columns encoding, change, gathered, sums;
    /// @}
    /// Of the first network.
    typename Part<0>::Workspace encoder;
    typename Part<1>::Workspace message;  ///< the decoder's where there are no messages
    /// Of the last network.
    typename Part<Rounds>::Workspace decoder;
  };

  /// Fills `out` (Out x contacts) from `in` (In x contacts). A contact's encoding counts for as much
  /// as its `weight`. Allocates nothing.
  void forward(const Columns& in, std::span<const T> weight, Ends ends, Eigen::Index bodies, Columns& out,
               Workspace& own) const noexcept {
    const Eigen::Index n = std::ssize(ends);
    if (n == 0) return;
    this->template part<0>().forward(in.leftCols(n), own.encoding.leftCols(n), own.encoder);
    for (Eigen::Index c = 0; c < n; ++c) own.encoding.col(c) *= weight[static_cast<std::size_t>(c)];
    detail::unrolled<Rounds - 1>([&](auto r) {
      gather(own.encoding, ends, bodies, own.sums, own.gathered);
      this->template part<r + 1>().forward(own.gathered.leftCols(n), own.change.leftCols(n), own.message);
      own.encoding.leftCols(n) += own.change.leftCols(n);
    });
    this->template part<Rounds>().forward(own.encoding.leftCols(n), out.leftCols(n), own.decoder);
  }

  /// What a pass leaves for the way back. It grows with the contacts that it is given.
  class Record {
   public:
    /// As forward(), and keeps what backward() needs.
    void forward(const ContactNetwork& network, const Columns& in, std::span<const T> weight, Ends ends,
                 Eigen::Index bodies, Columns& out) {
      const Eigen::Index n = std::ssize(ends);
      make_room(n, bodies);
      if (n == 0) return;
      encoder_->record(network.template part<0>(), in.leftCols(n), plain_.leftCols(n));
      for (Eigen::Index c = 0; c < n; ++c)
        encoding_.col(c) = weight[static_cast<std::size_t>(c)] * plain_.col(c);
      detail::unrolled<Rounds - 1>([&](auto r) {
        gather(encoding_, ends, bodies, sums_, gathered_);
        messages_[r].record(network.template part<r + 1>(), gathered_.leftCols(n), change_.leftCols(n));
        encoding_.leftCols(n) += change_.leftCols(n);
      });
      decoder_->record(network.template part<Rounds>(), encoding_.leftCols(n), out.leftCols(n));
    }

    /// Adds to `gradient` (of the network's layout), and writes the derivatives by inputs and weights.
    void backward(const ContactNetwork& network, std::span<const T> weight, Ends ends, Eigen::Index bodies,
                  const Columns& by_outputs, std::span<T> gradient, Columns& by_inputs,
                  std::span<T> by_weight) {
      const Eigen::Index n = std::ssize(ends);
      if (n == 0) return;
      Columns &by_encoding = change_, &by_gathered = gathered_, &by_sums = sums_;
      decoder_->backward(network.template part<Rounds>(), by_outputs.leftCols(n),
                         Base::template part_of<Rounds>(gradient), by_encoding.leftCols(n));
      detail::unrolled<Rounds - 1>([&](auto reversed) {
        constexpr int r = Rounds - 2 - reversed;
        messages_[r].backward(network.template part<r + 1>(), by_encoding.leftCols(n),
                              Base::template part_of<r + 1>(gradient), by_gathered.leftCols(n));
        scatter(by_gathered, ends, bodies, by_sums, by_encoding);
      });
      for (Eigen::Index c = 0; c < n; ++c) {
        by_weight[static_cast<std::size_t>(c)] = by_encoding.col(c).dot(plain_.col(c));
        by_encoding.col(c) *= weight[static_cast<std::size_t>(c)];
      }
      encoder_->backward(network.template part<0>(), by_encoding.leftCols(n),
                         Base::template part_of<0>(gradient), by_inputs.leftCols(n));
    }

   private:
    void make_room(Eigen::Index contacts, Eigen::Index bodies) {
      if (bodies > sums_.cols()) sums_.resize(Width, bodies);
      if (encoder_ && contacts <= encoder_->capacity()) return;
      const Eigen::Index room = contacts + contacts / 2 + 8;
      encoder_.emplace(room);
      messages_.assign(Rounds - 1, Tape<Part<1>>(Rounds > 1 ? room : 1));
      decoder_.emplace(room);
      for (Columns* columns : {&plain_, &encoding_, &change_}) columns->resize(Width, room);
      gathered_.resize(3 * Width, room);
    }

    std::optional<Tape<Part<0>>> encoder_;
    std::vector<Tape<Part<1>>> messages_;
    std::optional<Tape<Part<Rounds>>> decoder_;
    Columns plain_, encoding_, change_, gathered_, sums_;
  };

 private:
  /// Each contact's encoding, and the sums over the contacts of its two bodies: added, and weighted by the
  /// bodies' shares of the mobility. Bodies in the other order give the same.
  static void gather(const Columns& encoding, Ends ends, Eigen::Index bodies, Columns& sums,
                     Columns& gathered) noexcept {
    sums.leftCols(bodies).setZero();
    Eigen::Index c = 0;
    for (const detail::ContactEnds& end : ends) {
      sums.col(end.second) += encoding.col(c);
      if (end.first >= 0) sums.col(end.first) += encoding.col(c);
      ++c;
    }
    c = 0;
    for (const detail::ContactEnds& end : ends) {
      auto to = gathered.col(c);
      to.template segment<Width>(0) = encoding.col(c);
      to.template segment<Width>(Width) = sums.col(end.second);
      to.template segment<Width>(2 * Width) = static_cast<T>(end.second_share) * sums.col(end.second);
      if (end.first >= 0) {
        to.template segment<Width>(Width) += sums.col(end.first);
        to.template segment<Width>(2 * Width) += static_cast<T>(end.first_share) * sums.col(end.first);
      }
      ++c;
    }
  }

  /// The way back through gather(): adds to by_encoding.
  static void scatter(const Columns& by_gathered, Ends ends, Eigen::Index bodies, Columns& by_sums,
                      Columns& by_encoding) noexcept {
    by_sums.leftCols(bodies).setZero();
    Eigen::Index c = 0;
    for (const detail::ContactEnds& end : ends) {
      const auto from = by_gathered.col(c++);
      const auto added = from.template segment<Width>(Width),
                 shared = from.template segment<Width>(2 * Width);
      by_sums.col(end.second) += added + static_cast<T>(end.second_share) * shared;
      if (end.first >= 0) by_sums.col(end.first) += added + static_cast<T>(end.first_share) * shared;
    }
    c = 0;
    for (const detail::ContactEnds& end : ends) {
      by_encoding.col(c) += by_gathered.col(c).template segment<Width>(0) + by_sums.col(end.second);
      if (end.first >= 0) by_encoding.col(c) += by_sums.col(end.first);
      ++c;
    }
  }
};

}  // namespace rbres::RBRES_ABI
