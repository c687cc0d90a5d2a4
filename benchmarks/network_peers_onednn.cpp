/// oneDNN (Debian: libdnnl-dev), one thread: inner products with ReLU and the residual sum as fused
/// post-operations, the weights reordered once into the layout it prefers.
#include <omp.h>

#include <dnnl.hpp>
#include <unordered_map>

#include "network_peers.hpp"

namespace rbres::bench {
namespace {

class OneDnn {
 public:
  OneDnn(const std::vector<LinearLayer>& layers, int batch) : batch_(batch) {
    omp_set_num_threads(1);  // Debian builds oneDNN on OpenMP
    input_ = buffer(inputs);
    const dnnl::memory state = buffer(width), hidden = buffer(width), output = buffer(outputs);
    add(layers.front(), input_, state);
    for (std::size_t i = 1; i + 1 < layers.size(); i += 2) {
      add(layers[i], state, hidden);
      add(layers[i + 1], hidden, state);
    }
    add(layers.back(), state, output);
    output_ = output;
    stream_.wait();
  }

  const float* run(const float* input) {
    input_.set_data_handle(const_cast<float*>(input));
    for (const auto& [primitive, arguments] : steps_) primitive.execute(stream_, arguments);
    stream_.wait();
    return static_cast<const float*>(output_.get_data_handle());
  }

  const char* mode() const { return ""; }

 private:
  using Tag = dnnl::memory::format_tag;
  static dnnl::memory::desc describe(dnnl::memory::dims dims, Tag tag) {
    return {std::move(dims), dnnl::memory::data_type::f32, tag};
  }
  dnnl::memory buffer(int features) { return {describe({batch_, features}, Tag::nc), engine_}; }

  void add(const LinearLayer& layer, const dnnl::memory& from, const dnnl::memory& to) {
    const dnnl::memory::dims shape{layer.out, layer.in};
    dnnl::post_ops post;
    if (layer.after == After::relu) post.append_eltwise(1.0f, dnnl::algorithm::eltwise_relu, 0.0f, 0.0f);
    if (layer.after == After::sum) post.append_sum(1.0f);
    dnnl::primitive_attr attributes;
    attributes.set_post_ops(post);
    const dnnl::inner_product_forward::primitive_desc description(
        {dnnl::prop_kind::forward_inference, from.get_desc(), describe(shape, Tag::any),
         describe({layer.out}, Tag::x), to.get_desc()},
        attributes, engine_);
    dnnl::memory weights(description.weights_desc(), engine_), bias(description.bias_desc(), engine_);
    copy(layer.weights, describe(shape, Tag::oi), weights);
    copy(layer.bias, describe({layer.out}, Tag::x), bias);
    steps_.push_back(
        {dnnl::inner_product_forward(description),
         {{DNNL_ARG_SRC, from}, {DNNL_ARG_WEIGHTS, weights}, {DNNL_ARG_BIAS, bias}, {DNNL_ARG_DST, to}}});
  }

  void copy(const std::vector<float>& values, const dnnl::memory::desc& layout, dnnl::memory& to) {
    dnnl::memory plain(layout, engine_, const_cast<float*>(values.data()));
    dnnl::reorder(plain, to).execute(stream_, plain, to);
    stream_.wait();
  }

  struct Step {
    dnnl::primitive primitive;
    std::unordered_map<int, dnnl::memory> arguments;
  };

  dnnl::memory::dim batch_;
  dnnl::engine engine_{dnnl::engine::kind::cpu, 0};
  dnnl::stream stream_{engine_};
  dnnl::memory input_, output_;
  std::vector<Step> steps_;
};

const bool registered = (register_inference<OneDnn>("onednn"), true);

}  // namespace
}  // namespace rbres::bench
