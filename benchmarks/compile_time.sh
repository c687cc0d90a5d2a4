#!/usr/bin/env bash
# How long <rbres/rbres.hpp> takes to compile, over <Eigen/Dense> alone: processor time of the compiler, interleaved
# repetitions.
# Usage: compile_time.sh COMPILER RBRES_INCLUDE EIGEN_INCLUDE [REPETITIONS]
set -euo pipefail
compiler=$1 rbres=$2 eigen=$3 repetitions=${4:-9}

folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT
echo '#include <Eigen/Dense>' > "$folder/eigen.cpp"
echo '#include <rbres/rbres.hpp>' > "$folder/rbres.cpp"

exec 3>&2 # what the compiler says goes past the timing
TIMEFORMAT='%U %S'
seconds() {
  { time "$compiler" -std=c++20 -O2 -I"$rbres" -isystem "$eigen" -c "$folder/$1.cpp" -o "$folder/$1.o" 2>&3; } 2>&1 |
    awk '{ print $1 + $2 }'
}

seconds eigen > /dev/null # the files are in memory from here on
for ((i = 0; i < repetitions; ++i)); do
  first=$(seconds eigen)
  second=$(seconds rbres)
  echo "$first $second"
done | awk '
  function sorted(list, n,   i, j, x) {
    for (i = 2; i <= n; ++i)
      for (j = i; j > 1 && list[j - 1] > list[j]; --j) { x = list[j]; list[j] = list[j - 1]; list[j - 1] = x }
  }
  function median(list, n) { return (list[int((n + 1) / 2)] + list[int(n / 2) + 1]) / 2 }
  { eigen[NR] = $1; rbres[NR] = $2; ratio[NR] = $2 / $1 }
  END {
    if (NR == 0) exit 1
    sorted(eigen, NR); sorted(rbres, NR); sorted(ratio, NR)
    printf "<Eigen/Dense>      %.3f s\n<rbres/rbres.hpp>  %.3f s\n", median(eigen, NR), median(rbres, NR)
    printf "ratio              %.2f  [%.2f, %.2f] (aim: at most 1.50; median of %d [smallest, largest])\n",
           median(ratio, NR), ratio[1], ratio[NR], NR
  }'
