// A network through a file and back.
#include <cstdio>
#include <rbres/io.hpp>
#include <rbres/rbres.hpp>

int main() {
  using namespace rbres;
  using Net = ResidualNetwork<float, 13, 16, 1, 13>;
  const Net network(1);
  save("network.safetensors", network);
  const Net loaded = load<Net>("network.safetensors");
  std::remove("network.safetensors");

  const Net::Input input = Net::Input::Ones();
  const bool same = loaded.forward(input) == network.forward(input);
  std::puts(same ? "loaded what was saved" : "loaded something else");
  return same ? 0 : 1;
}
