// SPDX-License-Identifier: Apache-2.0
// The queue against a list that is searched through.
#include "builder/decimate/removal_queue.h"

#include <catch2/catch.hpp>
#include <map>
#include <random>

namespace mtdb::testing {

using namespace internal;

TEST_CASE("The cheapest vertex comes first, where it was pushed last") {
  std::mt19937 random(1);
  RemovalQueue queue;
  for (const uint32_t vertices : {1u, 7u, 300u}) {
    queue.Reset(vertices);
    std::map<uint32_t, float> model;
    for (int i = 0; i < 5000; ++i) {
      const uint32_t v = random() % vertices;
      if (random() % 3 != 0) {
        const double error = static_cast<double>(random() % 50) / 8;
        queue.Push(v, error);
        model[v] = static_cast<float>(error);
      }
      const double bound = static_cast<double>(random() % 50) / 8;
      bool cheaper = false;
      for (const auto& [w, error] : model) cheaper |= error < static_cast<float>(bound);
      if (cheaper) REQUIRE(queue.HasCheaperThan(bound));
      if (random() % 2 == 0) continue;
      const auto least =
          std::min_element(model.begin(), model.end(), [](const auto& a, const auto& b) {
            return std::pair(a.second, a.first) < std::pair(b.second, b.first);
          });
      const std::optional<uint32_t> popped = queue.Pop();
      REQUIRE(popped.has_value() == !model.empty());
      if (!popped) continue;
      REQUIRE(*popped == least->first);
      model.erase(least);
    }
  }
}

TEST_CASE("A stale vertex waits a little longer, and one that was too dear until the end") {
  RemovalQueue queue;
  queue.Reset(4);
  queue.Push(0, 1);
  queue.Push(1, 1.05);
  queue.Push(2, 9);
  queue.Push(3, 0.5);
  REQUIRE(queue.Pop() == 3u);  // and not pushed again
  queue.PushStale(0);
  queue.PushStale(3);
  REQUIRE(queue.Pop() == 1u);
  REQUIRE(queue.Pop() == 0u);
  REQUIRE(queue.Pop() == 2u);
  REQUIRE(queue.Pop() == 3u);
  REQUIRE(!queue.Pop());
  REQUIRE(!queue.HasCheaperThan(1e9));
}

}  // namespace mtdb::testing
