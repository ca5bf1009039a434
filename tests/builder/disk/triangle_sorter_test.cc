// SPDX-License-Identifier: Apache-2.0
// The external sort of a round's triangles: a permutation in order of the curve, whatever the
// memory.
#include "builder/disk/triangle_sorter.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <random>

#include "builder/tiles/tiling.h"

namespace mtdb::testing {

using namespace internal;

namespace {

const Box3d kBounds{{-3, 5, 0}, {7, 6, 0.01}};

// Numbered by their first vertex. With few places, many codes are equal.
std::vector<TileTriangle> RandomTriangles(size_t count, uint32_t places, const Grid& grid) {
  std::mt19937 random(1);
  std::vector<TileTriangle> triangles(count);
  for (size_t i = 0; i < count; ++i) {
    TileTriangle& t = triangles[i];
    t.vertices = {static_cast<uint32_t>(i), static_cast<uint32_t>(random()), 7};
    t.child_slot = static_cast<uint32_t>(i * 3);
    Vec3d p;
    for (int a = 0; a < 3; ++a) {
      const double u = static_cast<double>(random() % places) / places;
      p[a] = kBounds.min[a] + (kBounds.max[a] - kBounds.min[a]) * u;
    }
    t.positions.fill(grid.Quantize(p));
  }
  return triangles;
}

}  // namespace

TEST_CASE("Sorting is a permutation in order of codes, ties by vertices, for any memory") {
  Grid grid;
  grid.origin = kBounds.min;
  grid.step = 1e-4;
  const RoundCurve curve(kBounds, 3);
  const SpoolSpace space{std::filesystem::temp_directory_path().string()};
  constexpr size_t kRow = 5;
  for (const uint32_t places : {3u, 10000u}) {
    for (const size_t count : {size_t{0}, size_t{1}, size_t{1000}, size_t{120000}}) {
      std::vector<TileTriangle> input = RandomTriangles(count, places, grid);
      std::vector<uint32_t> first;
      for (const size_t memory : {size_t{64} << 20, size_t{2} << 20, size_t{0}}) {
        const auto threads = static_cast<unsigned>(memory % 3 + 1);
        INFO(places << " places, " << count << " triangles, memory " << memory);
        std::shuffle(input.begin(), input.end(), std::mt19937(threads));
        TriangleSorter sorter({&space, memory, kRow, threads});
        for (const TileTriangle& t : input) {
          std::array<std::byte, 3 * kRow> rows;
          rows.fill(static_cast<std::byte>(t.vertices[0]));
          REQUIRE(sorter.Add(t, rows.data(), curve.Code(t, grid)).ok());
        }
        REQUIRE(sorter.count() == count);
        REQUIRE(sorter.Finish().ok());
        std::vector<uint32_t> order;
        bool good = true;
        uint64_t last_code = 0;
        for (size_t done = 0; done < count;) {
          const size_t take = std::min<size_t>(count - done, 1 + (done * 7919) % 3000);
          TriangleBlock read;
          uint64_t code = 0;
          REQUIRE(sorter.Next(take, &read, &code).ok());
          const auto& [block, rows] = read;
          REQUIRE(block.size() == take);
          REQUIRE(rows.size() == take * 3 * kRow);
          good &= code == curve.Code(block[0], grid);
          for (size_t i = 0; i < take; ++i) {
            const TileTriangle& t = block[i];
            const uint64_t c = curve.Code(t, grid);
            good &= c >> 63 == 0;
            good &= last_code < c ||
                    (last_code == c && (order.empty() || order.back() < t.vertices[0]));
            good &= t.child_slot == 3 * t.vertices[0];
            for (size_t b = 0; b < 3 * kRow; ++b) {
              good &= rows[i * 3 * kRow + b] == static_cast<std::byte>(t.vertices[0]);
            }
            last_code = c;
            order.push_back(t.vertices[0]);
          }
          done += take;
        }
        REQUIRE(good);
        if (first.empty()) first = order;
        REQUIRE(first == order);
        std::sort(order.begin(), order.end());
        for (size_t i = 0; i < count; ++i) REQUIRE(order[i] == i);
      }
    }
  }
}

}  // namespace mtdb::testing
