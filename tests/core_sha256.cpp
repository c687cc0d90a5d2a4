// SHA-256 against the examples of FIPS 180-4's authors (csrc.nist.gov, "SHA256.pdf", "SHA2_Additional.pdf").
#include <doctest/doctest.h>

#include <rbres/core/sha256.hpp>

using rbres::Sha256;

namespace {

std::string digest(const std::string& bytes) {
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  return hash.text();
}

}  // namespace

TEST_CASE("published digests") {
  CHECK(digest("") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  CHECK(digest("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  CHECK(digest("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq") ==
        "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  CHECK(
      digest("abcdefghbcdefghicdefghijdefghijkefghijklfghijklmghijklmnhijklmnoijklmnopjklmnopqklmnopqrlmnopq"
             "rsmnopqrstnopqrstu") == "cf5b16a778af8380036ce59e7b0492370b249b11e8f07a51afac45037afee9d1");
  CHECK(digest("\xbd") == "68325720aabd7c82f30f554b313d0570c95accbb7dc4b5aae11204c08ffe732b");
  CHECK(digest("\xc9\x8c\x8e\x55") == "7abc22c0ae5af26ce93dbb94433a0e0b2e119d014f8e7f65bd56c61ccccd9504");
  // Zeros: the lengths around the end of a block decide where the padding goes.
  CHECK(digest(std::string(55, '\0')) == "02779466cdec163811d078815c633f21901413081449002f24aa3e80f0b88ef7");
  CHECK(digest(std::string(56, '\0')) == "d4817aa5497628e7c77e6b606107042bbba3130888c5f47a375e6179be789fbb");
  CHECK(digest(std::string(57, '\0')) == "65a16cb7861335d5ace3c60718b5052e44660726da4cd13bb745381b235a1785");
  CHECK(digest(std::string(64, '\0')) == "f5a5fd42d16a20302798ef6ed309979b43003d2320d9f0e8ea9831a92759fb4b");
  CHECK(digest(std::string(1000, '\0')) ==
        "541b3e9daa09b20bf85fa273e5cbd3e80185aa4ec298e765db87742b70138a53");
  CHECK(digest(std::string(1'000'000, 'a')) ==
        "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST_CASE("the same digest in parts of any length, and a copy goes on by itself") {
  std::string bytes;
  for (int i = 0; i < 200; ++i) bytes += static_cast<char>(i * 7);
  const std::string whole = digest(bytes);
  for (std::size_t part = 1; part <= bytes.size(); ++part) {
    Sha256 hash;
    for (std::size_t at = 0; at < bytes.size(); at += part)
      hash.add(bytes.data() + at, std::min(part, bytes.size() - at));
    CHECK(hash.text() == whole);
  }
  Sha256 hash;
  hash.add(bytes.data(), 70);
  CHECK(hash.text() == digest(bytes.substr(0, 70)));  // asking changes nothing
  Sha256 other = hash;
  other.add("x", 1);
  hash.add(bytes.data() + 70, bytes.size() - 70);
  CHECK(hash.text() == whole);
  CHECK(other.text() == digest(bytes.substr(0, 70) + "x"));
}
