/// libtorch (Debian: libtorch-dev) in its best mode: what is timed is the fastest of the modes named below,
/// found by a short trial on the row's own work; the row's label says which.
#include <ATen/core/dispatch/Dispatcher.h>
#include <dlfcn.h>
#include <torch/torch.h>

#include <functional>
#include <limits>

#include "network_peers.hpp"

namespace rbres::bench {
namespace {

using torch::Tensor;

/// Threads of libtorch's own operators and, where its BLAS is OpenBLAS, of the matrix products.
void set_threads(int torch_threads, int blas_threads) {
  at::set_num_threads(torch_threads);
  if (void* symbol = dlsym(RTLD_DEFAULT, "openblas_set_num_threads"))
    reinterpret_cast<void (*)(int)>(symbol)(blas_threads);
}

/// Runs each mode's work in turn, five times for at least 2 ms by this clock; returns the index of the
/// fastest.
std::size_t fastest(const std::vector<std::function<void()>>& works, double (*clock)()) {
  std::size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 5; ++round)
    for (std::size_t i = 0; i < works.size(); ++i) {
      const double start = clock();
      double passed = 0.0;
      int calls = 0;
      for (; passed < 2e-3; passed = clock() - start, ++calls) works[i]();
      if (round > 0 && passed / calls < least) least = passed / calls, best = i;  // the first round warms up
    }
  return best;
}

Tensor tensor(const std::vector<float>& values, at::IntArrayRef shape) {
  return torch::tensor(at::ArrayRef<float>(values)).view(shape).clone();
}

/// Inference without autograd, one thread.
class LibtorchInference {
 public:
  LibtorchInference(const std::vector<LinearLayer>& layers, int batch) : batch_(batch) {
    const c10::InferenceMode guard;
    set_threads(1, 1);
    for (const LinearLayer& layer : layers) {
      const Tensor weights = tensor(layer.weights, {layer.out, layer.in}),
                   bias = tensor(layer.bias, {layer.out});
      layers_.push_back({weights, weights.t(), weights.t().contiguous(), bias, weights.to_mkldnn(),
                         bias.to_mkldnn(), xnnpack_prepack(weights, bias, layer.after == After::relu)});
    }
    state_ = torch::empty({batch, width});
    hidden_ = torch::empty({batch, width});
    output_ = torch::empty({batch, outputs});
    modes_ = {{"addmm", [this](const Tensor& x) { addmm(x, &Layer::transposed_view); }},
              {"addmm, weights transposed", [this](const Tensor& x) { addmm(x, &Layer::transposed); }},
              {"mkldnn", [this](const Tensor& x) { mkldnn(x); }},
              {"xnnpack", [this](const Tensor& x) { xnnpack(x); }}};
    if (batch == 1) modes_.push_back({"addmv", [this](const Tensor& x) { addmv(x); }});
    const Tensor trial = tensor(samples(batch, inputs), {batch, inputs});
    std::vector<std::function<void()>> works;
    for (const Mode& mode : modes_) works.push_back([&] { mode.run(trial); });
    best_ = fastest(works, thread_seconds);
  }

  const float* run(const float* input) {
    const c10::InferenceMode guard;
    modes_[best_].run(torch::from_blob(const_cast<float*>(input), {batch_, inputs}));
    return output_.data_ptr<float>();
  }

  const char* mode() const { return modes_[best_].name; }

 private:
  struct Layer {
    Tensor weights, transposed_view, transposed, bias, mkldnn_weights, mkldnn_bias;
    c10::IValue xnnpack;
  };
  struct Mode {
    const char* name;
    std::function<void(const Tensor&)> run;
  };

  /// Matrix products into buffers that are kept; the residual sum is the beta of the product.
  void addmm(const Tensor& x, Tensor Layer::*weights) {
    const auto last = layers_.size() - 1;
    at::addmm_out(state_, layers_[0].bias, x, layers_[0].*weights).relu_();
    for (std::size_t i = 1; i < last; i += 2) {
      at::addmm_out(hidden_, layers_[i].bias, state_, layers_[i].*weights).relu_();
      state_.addmm_(hidden_, layers_[i + 1].*weights).add_(layers_[i + 1].bias);
    }
    at::addmm_out(output_, layers_[last].bias, state_, layers_[last].*weights);
  }

  /// The same with matrix-vector products.
  void addmv(const Tensor& x) {
    const auto last = layers_.size() - 1;
    Tensor state = state_.view({width}), hidden = hidden_.view({width}), output = output_.view({outputs});
    at::addmv_out(state, layers_[0].bias, layers_[0].weights, x.view({inputs})).relu_();
    for (std::size_t i = 1; i < last; i += 2) {
      at::addmv_out(hidden, layers_[i].bias, layers_[i].weights, state).relu_();
      state.addmv_(layers_[i + 1].weights, hidden).add_(layers_[i + 1].bias);
    }
    at::addmv_out(output, layers_[last].bias, layers_[last].weights, state);
  }

  /// oneDNN's layout from the first layer to the last.
  void mkldnn(const Tensor& x) {
    const auto linear = [](const Tensor& from, const Layer& layer) {
      return at::mkldnn_linear(from, layer.mkldnn_weights, layer.mkldnn_bias);
    };
    Tensor state = linear(x.to_mkldnn(), layers_[0]).relu_();
    for (std::size_t i = 1; i + 1 < layers_.size(); i += 2)
      state.add_(linear(linear(state, layers_[i]).relu_(), layers_[i + 1]));
    output_ = linear(state, layers_.back()).to_dense();
  }

  /// XNNPACK on prepacked weights, the ReLU fused.
  void xnnpack(const Tensor& x) {
    static const auto operation =
        c10::Dispatcher::singleton().findSchemaOrThrow("prepacked::linear_clamp_run", "");
    const auto linear = [](const Tensor& from, const Layer& layer) {
      torch::jit::Stack stack{from, layer.xnnpack};
      operation.callBoxed(&stack);
      return stack.front().toTensor();
    };
    Tensor state = linear(x, layers_[0]);
    for (std::size_t i = 1; i + 1 < layers_.size(); i += 2)
      state.add_(linear(linear(state, layers_[i]), layers_[i + 1]));
    output_ = linear(state, layers_.back());
  }
  static c10::IValue xnnpack_prepack(const Tensor& weights, const Tensor& bias, bool relu) {
    static const auto operation =
        c10::Dispatcher::singleton().findSchemaOrThrow("prepacked::linear_clamp_prepack", "");
    torch::jit::Stack stack{weights, bias, relu ? c10::IValue(at::Scalar(0.0)) : c10::IValue(),
                            c10::IValue()};
    operation.callBoxed(&stack);
    return stack.front();
  }

  int batch_;
  std::vector<Layer> layers_;
  Tensor state_, hidden_, output_;
  std::vector<Mode> modes_;
  std::size_t best_ = 0;
};

/// One step of training: forward with dropout, mean over samples of the squared norm, backward, Adam with L2
/// on the weights (a weight decay of 2 lambda, the gradient of lambda times the sum of w^2).
class LibtorchTraining {
 public:
  LibtorchTraining(const std::vector<LinearLayer>& layers, int batch)
      : input_(tensor(samples(batch, inputs), {batch, inputs})),
        target_(tensor(samples(batch, outputs), {batch, outputs})) {
    for (const LinearLayer& layer : layers) {
      weights_.push_back(tensor(layer.weights, {layer.out, layer.in}).requires_grad_());
      biases_.push_back(tensor(layer.bias, {layer.out}).requires_grad_());
    }
    using Options = torch::optim::AdamOptions;
    std::vector<torch::optim::OptimizerParamGroup> groups;
    groups.emplace_back(weights_, std::make_unique<Options>(Options(learning_rate).weight_decay(2 * l2)));
    groups.emplace_back(biases_, std::make_unique<Options>(Options(learning_rate)));
    adam_ = std::make_unique<torch::optim::Adam>(groups, Options(learning_rate));
  }

  void step() {
    Tensor x = at::linear(input_, weights_.front(), biases_.front()).relu_();
    for (std::size_t i = 1; i + 1 < weights_.size(); i += 2) {
      const Tensor hidden = at::dropout(at::linear(x, weights_[i], biases_[i]).relu_(), dropout, true);
      x = x + at::linear(hidden, weights_[i + 1], biases_[i + 1]);
    }
    const Tensor output = at::linear(x, weights_.back(), biases_.back());
    const Tensor loss = at::mse_loss(output, target_, at::Reduction::Sum) / output.size(0);
    for (auto* parameters : {&weights_, &biases_})  // quicker than zero_grad(), which keeps and fills them
      for (Tensor& parameter : *parameters) parameter.mutable_grad() = Tensor();
    loss.backward();
    adam_->step();
    loss_ = loss;
  }

  double loss() const { return loss_.item<double>(); }

 private:
  Tensor input_, target_, loss_;
  std::vector<Tensor> weights_, biases_;
  std::unique_ptr<torch::optim::Adam> adam_;
};

void train(benchmark::State& state, int blocks, int batch, int threads) {
  LibtorchTraining training(network(blocks), batch);
  struct Setting {
    int torch, blas;
  };
  const std::vector<Setting> settings =
      threads == 1 ? std::vector<Setting>{{1, 1}} : std::vector<Setting>{{2, 1}, {1, 2}, {2, 2}};
  std::vector<std::function<void()>> works;
  for (const Setting& setting : settings)
    works.push_back([&] {
      set_threads(setting.torch, setting.blas);
      training.step();
    });
  const Setting best = settings[fastest(works, threads == 1 ? thread_seconds : wall_seconds)];
  set_threads(best.torch, best.blas);
  measure(
      state, "us_per_step", 0, [&] { training.step(); }, threads == 1 ? thread_seconds : wall_seconds);
  state.counters["loss"] = training.loss();
  state.SetLabel("threads: operators " + std::to_string(best.torch) + ", BLAS " + std::to_string(best.blas));
}

const bool registered = [] {
  register_inference<LibtorchInference>("libtorch");
  for (const int blocks : {10, 4})
    for (const int batch : train_batches)
      for (const int threads : {1, 2})
        benchmark::RegisterBenchmark(train_row(blocks, batch, threads, "libtorch").c_str(), train, blocks,
                                     batch, threads)
            ->Unit(benchmark::kMicrosecond);
  return true;
}();

}  // namespace
}  // namespace rbres::bench
