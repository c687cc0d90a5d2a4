#!/usr/bin/env bash
# How long small programs take to compile, beside <Eigen/Dense> alone: processor time of the compiler, interleaved
# repetitions, and its largest memory where GNU time (Debian's package time) is there.
# Usage: compile_time.sh COMPILER RBRES_INCLUDE EIGEN_INCLUDE [REPETITIONS]
set -euo pipefail
compiler=$1 rbres=$2 eigen=$3 repetitions=${4:-5}

folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT
names=(eigen rbres simulate load train)
declare -A titles=([eigen]="<Eigen/Dense>" [rbres]="<rbres/rbres.hpp>" [simulate]="simulate one ball"
                   [load]="load and use a predictor" [train]="simulate many, train")
echo '#include <Eigen/Dense>' > "$folder/eigen.cpp"
echo '#include <rbres/rbres.hpp>' > "$folder/rbres.cpp"
cat > "$folder/simulate.cpp" <<'EOF'
#include <rbres/sim/simulate.hpp>
using namespace rbres;
int main() {
  const System<double, 1, Sphere<double>> system{{Body{Sphere{0.1}, 1.0}}, {floor_plane<double>()}};
  SystemState<double, 1> y;
  y[0].position.z = 1;
  simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 1});
}
EOF
cat > "$folder/load.cpp" <<'EOF'
#include <rbres/io/predictor.hpp>
using namespace rbres;
int main() {
  const auto predictor = load<ResidualPredictor<float, 4>>("model.safetensors");
  return predictor.predict({}, {})[0].position.x > 0;
}
EOF
cat > "$folder/train.cpp" <<'EOF'
#include <rbres/rbres.hpp>
using namespace rbres;
int main() {
  const Body ball{Sphere{0.1}, 1.0};
  const System<double, 2, Sphere<double>> system{{ball, ball}, {floor_plane<double>()}};
  const auto start = [](std::ptrdiff_t i) {
    Start<2> s;
    s.state[1].position.x = 1 + 0.01 * static_cast<double>(i);
    return s;
  };
  using Net = Network<float, Sequential<Linear<38, 128>, Relu, Linear<128, 26>>>;
  Predictor<Net, 2> predictor{Net(1), {}, {}, {system}};
  train_predictor(predictor, simulate_transitions(system, Gravity{}, Rk4{}, 100, start, {.step = 1e-3, .duration = 0.1}));
}
EOF

exec 3>&2 # what the compiler says goes past the timing
TIMEFORMAT='%U %S'
compile() { "$@" "$compiler" -std=c++20 -O2 -I"$rbres" -isystem "$eigen" -c "$folder/$name.cpp" -o "$folder/$name.o"; }
for ((i = 0; i <= repetitions; ++i)); do # the first time only brings the files into memory
  for name in "${names[@]}"; do
    seconds=$({ time compile 2>&3; } 2>&1 | awk '{ print $1 + $2 }')
    [ "$i" -eq 0 ] || echo "$name $seconds" >> "$folder/seconds"
  done
done

# Prints the median, least and greatest of the numbers that it reads.
spread() { sort -n | awk '{ all[NR] = $1 } END { print (all[int((NR + 1) / 2)] + all[int(NR / 2) + 1]) / 2, all[1], all[NR] }'; }

printf "%-26s %8s  %-16s %8s\n" "-O2" "s" "[least, most]" "MB"
for name in "${names[@]}"; do
  memory=-
  if [ -x /usr/bin/time ]; then
    compile /usr/bin/time -f %M -o "$folder/kilobytes"
    memory=$(($(cat "$folder/kilobytes") / 1000))
  fi
  read -r median least most < <(awk -v name="$name" '$1 == name { print $2 }' "$folder/seconds" | spread)
  printf "%-26s %8.2f  [%.2f, %.2f] %9s\n" "${titles[$name]}" "$median" "$least" "$most" "$memory"
done
read -r median least most < <(awk '$1 == "eigen" { eigen[++e] = $2 } $1 == "rbres" { ratio[++r] = $2 / eigen[e] }
  END { for (i in ratio) print ratio[i] }' "$folder/seconds" | spread)
printf "<rbres/rbres.hpp> / <Eigen/Dense>: %.2f  [%.2f, %.2f] (aim: at most 1.50)\n" "$median" "$least" "$most"
