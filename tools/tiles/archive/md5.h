// SPDX-License-Identifier: Apache-2.0
// MD5 (RFC 1321), by which archives of tiles find files. It keeps nobody from forging anything.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>

namespace mtdb {

inline std::array<uint8_t, 16> Md5(std::string_view text) {
  constexpr std::array<std::array<int, 4>, 4> kTurns{
      {{7, 12, 17, 22}, {5, 9, 14, 20}, {4, 11, 16, 23}, {6, 10, 15, 21}}};
  std::array<uint32_t, 4> state{0x67452301, 0xefcdab89, 0x98badcfe, 0x10325476};
  std::string padded(text);
  padded += '\x80';
  while (padded.size() % 64 != 56) padded += '\0';
  for (int i = 0; i < 8; ++i) {
    padded += static_cast<char>(uint64_t{text.size()} * 8 >> (8 * i) & 255);
  }
  for (size_t block = 0; block < padded.size(); block += 64) {
    auto [a, b, c, d] = state;
    for (uint32_t i = 0; i < 64; ++i) {
      const uint32_t round = i / 16;
      uint32_t mixed = 0, word = 0;
      if (round == 0) {
        mixed = (b & c) | (~b & d), word = i;
      } else if (round == 1) {
        mixed = (d & b) | (~d & c), word = (5 * i + 1) % 16;
      } else if (round == 2) {
        mixed = b ^ c ^ d, word = (3 * i + 5) % 16;
      } else {
        mixed = c ^ (b | ~d), word = 7 * i % 16;
      }
      uint32_t of_text = 0;
      for (uint32_t k = 0; k < 4; ++k) {
        of_text |= uint32_t{static_cast<uint8_t>(padded[block + 4 * word + k])} << (8 * k);
      }
      const auto sine = static_cast<uint32_t>(std::floor(std::abs(std::sin(i + 1.0)) * 0x1p32));
      const uint32_t sum = a + mixed + sine + of_text;
      a = d, d = c, c = b;
      b += std::rotl(sum, kTurns[round][i % 4]);
    }
    state = {state[0] + a, state[1] + b, state[2] + c, state[3] + d};
  }
  std::array<uint8_t, 16> digest{};
  for (size_t i = 0; i < digest.size(); ++i) {
    digest[i] = static_cast<uint8_t>(state[i / 4] >> (8 * (i % 4)));
  }
  return digest;
}

}  // namespace mtdb
