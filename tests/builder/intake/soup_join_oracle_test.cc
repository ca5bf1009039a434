// SPDX-License-Identifier: Apache-2.0
// Corners of a soup get the numbers that a map of positions gives them, whatever the memory.
#include <catch2/catch.hpp>
#include <filesystem>
#include <map>
#include <random>
#include <tuple>

#include "builder/intake/soup_join.h"
#include "store/base/geometry.h"

namespace mtdb::testing {

using namespace internal;

TEST_CASE("A soup is joined by exact position in the order of first sight, for any memory") {
  const SpoolSpace space{std::filesystem::temp_directory_path().string()};
  std::mt19937 random(7);
  for (const size_t memory : {size_t{1} << 12, size_t{1} << 16, size_t{1} << 24}) {
    for (const int positions : {1, 5, 3000}) {
      Spool soup(&space, 1000);
      std::map<std::tuple<float, float, float>, uint32_t> numbers;
      std::vector<Vec3f> expected_vertices;
      std::vector<std::array<uint32_t, 3>> expected;
      for (int t = 0; t < 4000; ++t) {
        std::array<uint32_t, 3> triangle;
        for (uint32_t& v : triangle) {
          const auto at = static_cast<float>(random() % positions);
          // Zeros of both signs are one position.
          const Vec3f p{at, random() % 2 ? 0.0f : -0.0f, at * 0.1f};
          REQUIRE(soup.Append(&p, sizeof(p)).ok());
          const auto next = static_cast<uint32_t>(numbers.size());
          const auto [it, added] = numbers.try_emplace({p.x, 0.0f, p.z}, next);
          if (added) expected_vertices.push_back({p.x, 0.0f, p.z});
          v = it->second;
        }
        expected.push_back(triangle);
      }
      REQUIRE(soup.Finish().ok());
      Spool vertices(&space, 1000);
      std::vector<std::array<uint32_t, 3>> triangles;
      const Result<uint64_t> count =
          JoinSoup(soup, false, &space, memory, &vertices, [&](const std::array<uint32_t, 3>& t) {
            triangles.push_back(t);
            return Status::Ok();
          });
      REQUIRE(count.ok());
      REQUIRE(*count == expected_vertices.size());
      REQUIRE(triangles == expected);
      REQUIRE(vertices.Finish().ok());
      std::vector<Vec3f> found(*count);
      REQUIRE(vertices.Read(0, found.data(), found.size() * sizeof(Vec3f)).ok());
      REQUIRE(found == expected_vertices);
    }
  }
}

}  // namespace mtdb::testing
