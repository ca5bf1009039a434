// SPDX-License-Identifier: Apache-2.0
// What temporary files hold in few bytes comes back as it was, and their room goes back when it has
// been read.
#include <catch2/catch.hpp>
#include <filesystem>
#include <random>

#include "builder/disk/packed_triangle.h"
#include "builder/disk/spool.h"
#include "builder/disk/squeeze.h"
#include "builder/disk/triangle_sorter.h"
#include "builder/tiles/tiling.h"

namespace mtdb::testing {

using namespace internal;

namespace {

TEST_CASE("Packed triangles come back as they were") {
  std::mt19937 random(3);
  const auto number = [&]() -> uint32_t {  // small ones, large ones, and the largest
    const auto bits = random() % 33;
    return bits == 32 ? ~uint32_t{0} : random() & ((uint32_t{1} << bits) - 1);
  };
  for (const size_t row : {size_t{0}, size_t{1}, size_t{7}, size_t{300}, size_t{40000}}) {
    TrianglePacker packer(row);
    TriangleUnpacker unpacker(row);
    std::vector<TileTriangle> triangles;
    std::vector<Bytes> rows;
    std::vector<uint64_t> codes;
    Bytes packed;
    uint64_t code = 0;
    const size_t count = row > 1000 ? 50 : 5000;
    for (size_t i = 0; i < count; ++i) {
      TileTriangle t{};
      Bytes its_rows(3 * row);
      for (size_t c = 0; c < 3; ++c) {
        const uint64_t kind = random() % 4;
        if (kind > 0 && i > 0) {  // a corner that was there, sometimes with another row or place
          const size_t which = i - 1 - random() % std::min<size_t>(i, 300), corner = random() % 3;
          t.vertices[c] = triangles[which].vertices[corner];
          t.positions[c] = triangles[which].positions[corner];
          std::copy_n(rows[which].data() + corner * row, row, its_rows.data() + c * row);
          if (random() % 20 == 0) t.positions[c].y ^= 1;
          if (random() % 20 == 0 && row > 0) its_rows[c * row + row / 2] ^= std::byte{1};
          continue;
        }
        t.vertices[c] = number();
        for (int a = 0; a < 3; ++a) t.positions[c][a] = static_cast<int32_t>(number());
        for (size_t b = 0; b < row; ++b) its_rows[c * row + b] = static_cast<std::byte>(random());
      }
      if (random() % 2 == 0) {
        t.error = static_cast<float>(number());
        t.child = number();
        t.child_slot = number();
        t.height = number();
      }
      t.edges = static_cast<uint16_t>(random() % 3 == 0 ? random() & 0x7fff : 0);
      t.fans = static_cast<uint16_t>(random() % 3 == 0 ? random() & 0xfff : 0);
      t.set_explicit_arc(random() % 5 == 0);
      if (random() % 3 == 0) code += uint64_t{number()} << (random() % 30);
      Bytes bytes(packer.max_bytes());
      const size_t size = packer.Pack(t, its_rows.data(), code, bytes.data());
      REQUIRE(size <= packer.max_bytes());
      packed.insert(packed.end(), bytes.begin(), bytes.begin() + static_cast<ptrdiff_t>(size));
      triangles.push_back(t);
      rows.push_back(its_rows);
      codes.push_back(code);
    }
    packed.resize(packed.size() + unpacker.max_bytes());
    const std::byte* from = packed.data();
    for (size_t i = 0; i < count; ++i) {
      TileTriangle t;
      Bytes its_rows(3 * row);
      uint64_t its_code = 0;
      from = unpacker.Unpack(from, &t, its_rows.data(), &its_code);
      INFO(row << " bytes a row, triangle " << i);
      REQUIRE(std::memcmp(&t, &triangles[i], sizeof(t)) == 0);
      REQUIRE(its_rows == rows[i]);
      REQUIRE(its_code == codes[i]);
    }
    REQUIRE(from == packed.data() + packed.size() - unpacker.max_bytes());
  }
}

TEST_CASE("Any bytes are triangles of some kind") {
  std::mt19937 random(5);
  for (const size_t row : {size_t{0}, size_t{3}}) {
    TriangleUnpacker unpacker(row);
    Bytes rows(3 * row);
    for (int i = 0; i < 20000; ++i) {
      Bytes bytes(unpacker.max_bytes());
      for (std::byte& b : bytes) b = static_cast<std::byte>(random());
      TileTriangle t;
      uint64_t code = 0;
      const std::byte* end = unpacker.Unpack(bytes.data(), &t, rows.data(), &code);
      REQUIRE(end <= bytes.data() + bytes.size());
    }
  }
}

TEST_CASE("Squeezed tables come back as they were, and damaged ones are none") {
  std::mt19937 random(7);
  for (const size_t columns : {size_t{0}, size_t{1}, size_t{3}, size_t{17}}) {
    for (const size_t rows : {size_t{0}, size_t{1}, size_t{1000}}) {
      Bytes table(rows * std::max<size_t>(1, 4 * columns));
      for (std::byte& b : table) b = static_cast<std::byte>(random() % 5 == 0 ? random() : 0);
      const Bytes squeezed = SqueezeTable(table, columns);
      const std::optional<Bytes> back = UnsqueezeTable(squeezed, columns, table.size());
      REQUIRE(back.has_value());
      CHECK(*back == table);
      if (table.empty()) continue;
      CHECK(!UnsqueezeTable(squeezed, columns, table.size() - 1));
      for (size_t size = 0; size < squeezed.size(); size += 1 + squeezed.size() / 20) {
        CHECK(!UnsqueezeTable(ByteSpan(squeezed).first(size), columns, table.size()));
      }
    }
  }
}

TEST_CASE("A spool that is consumed gives its room back") {
  const SpoolSpace space{std::filesystem::temp_directory_path().string()};
  constexpr uint32_t kCount = 3000000;
  Spool spool(&space, 0);
  for (uint32_t i = 0; i < kCount; ++i) REQUIRE(spool.Append(&i, sizeof(i)).ok());
  REQUIRE(spool.Finish().ok());
  REQUIRE(space.file_bytes == kCount * sizeof(uint32_t));
  SpoolReader reader = SpoolReader::Consuming(&spool);
  bool good = true;
  for (uint32_t i = 0; i < kCount; ++i) {
    uint32_t read = 0;
    good &= reader.Get(&read) && read == i;
  }
  CHECK(good);
  CHECK(reader.remaining() == 0);
  // What the reader holds, and what is less than a block. File systems that cannot keep all.
  const uint64_t left = space.file_bytes;
  CHECK((left <= 3 * Spool::kBlock || left == kCount * sizeof(uint32_t)));
  spool = Spool(nullptr, 0);
  CHECK(space.file_bytes == 0);
}

TEST_CASE("Triangles beside each other take few bytes of a sorter's runs") {
  constexpr uint32_t kSide = 400;
  Grid grid;
  grid.step = 1;
  const Box3d bounds{{0, 0, 0}, {kSide, kSide, 1}};
  const RoundCurve curve(bounds, 1);
  const SpoolSpace space{std::filesystem::temp_directory_path().string()};
  TriangleSorter sorter({&space, 0, 0, 2});
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) {
      const auto corner = [&](uint32_t dx, uint32_t dy) { return (y + dy) * (kSide + 1) + x + dx; };
      const auto place = [&](uint32_t dx, uint32_t dy) {
        return Vec3i{static_cast<int32_t>(x + dx), static_cast<int32_t>(y + dy), 0};
      };
      TileTriangle t{};
      t.vertices = {corner(0, 0), corner(1, 0), corner(0, 1)};
      t.positions = {place(0, 0), place(1, 0), place(0, 1)};
      REQUIRE(sorter.Add(t, nullptr, curve.Code(t, grid)).ok());
      t.vertices = {corner(1, 0), corner(1, 1), corner(0, 1)};
      t.positions = {place(1, 0), place(1, 1), place(0, 1)};
      REQUIRE(sorter.Add(t, nullptr, curve.Code(t, grid)).ok());
    }
  }
  REQUIRE(sorter.Finish().ok());
  // 68 in memory. Runs of 256 triangles, as here, begin with strangers.
  CHECK(space.file_bytes < 22 * 2 * kSide * kSide);
  TriangleBlock block;
  uint64_t code = 0;
  REQUIRE(sorter.Next(2 * kSide * kSide, &block, &code).ok());
  CHECK(space.file_bytes == 0);
}

}  // namespace
}  // namespace mtdb::testing
