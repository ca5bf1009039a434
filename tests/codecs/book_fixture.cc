// SPDX-License-Identifier: Apache-2.0
#include "tests/codecs/book_fixture.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <utility>

#include "codecs/cluster/cluster_limits.h"

namespace mtdb::testing {
namespace {

using Corners = std::array<uint32_t, 3>;
using Edge = std::pair<uint32_t, uint32_t>;

Edge Between(uint32_t a, uint32_t b) { return {std::min(a, b), std::max(a, b)}; }

class Book {
 public:
  Book(const ClusterOptions& options, ClusterUpdates& updates)
      : options_(options), updates_(updates), random_(options.seed) {}

  void Run() {
    for (int page = 0; page < options_.pages; ++page) MakePage(page);
    std::vector<uint32_t> order(updates_.positions.size());
    for (uint32_t v = 0; v < order.size(); ++v) order[v] = v;
    const auto stay = static_cast<size_t>(options_.keep * static_cast<double>(order.size()));
    size_t left = order.size();
    for (int pass = 0; pass < 4 && left > stay; ++pass) {
      std::shuffle(order.begin(), order.end(), random_);
      for (const uint32_t v : order) {
        if (left > stay) left -= Remove(v);
      }
    }
  }

 private:
  // Those of odd numbers look the other way, so that the spine's triangles disagree.
  void MakePage(int page) {
    const int side = options_.side;
    const int width = side / 2;
    const auto first = static_cast<uint32_t>(updates_.positions.size());
    const auto noise = [&] { return static_cast<int32_t>(random_() % 60); };
    for (int x = page == 0 ? 0 : 1; x < width; ++x) {
      for (int y = 0; y < side; ++y) {
        updates_.positions.push_back({200 * x * (page - 1) + noise(), 256 * y + noise(),
                                      200 * x * (page % 2 == 0 ? 1 : 2) + noise()});
      }
    }
    const auto at = [&](int x, int y) {
      if (x == 0) return static_cast<uint32_t>(y);
      return first + static_cast<uint32_t>((x - (page == 0 ? 0 : 1)) * side + y);
    };
    for (int x = 0; x + 1 < width; ++x) {
      for (int y = 0; y + 1 < side; ++y) {
        for (Corners t : {Corners{at(x, y), at(x + 1, y), at(x + 1, y + 1)},
                          Corners{at(x, y), at(x + 1, y + 1), at(x, y + 1)}}) {
          if (page % 2 == 1) std::swap(t[0], t[1]);
          Add(t);
        }
      }
    }
  }

  void Add(const Corners& t) {
    const auto id = static_cast<uint32_t>(updates_.triangles.size());
    updates_.triangles.push_back(t);
    for (size_t i = 0; i < 3; ++i) {
      around_[t[i]].insert(id);
      ++uses_[{t[i], t[(i + 1) % 3]}];
    }
  }
  void Erase(uint32_t id) {
    const Corners& t = updates_.triangles[id];
    for (size_t i = 0; i < 3; ++i) {
      around_[t[i]].erase(id);
      --uses_[{t[i], t[(i + 1) % 3]}];
    }
  }
  int Uses(uint32_t from, uint32_t to) const {
    const auto at = uses_.find({from, to});
    return at == uses_.end() ? 0 : at->second;
  }
  // As in docs/glossary.md, "crease"; 0: none.
  int Order(uint32_t a, uint32_t b) const {
    const int forth = Uses(a, b);
    const int back = Uses(b, a);
    return forth == 1 && back == 1 ? 0 : forth + back;
  }

  // The rings of the fans of a vertex; none when it has to stay.
  std::vector<std::vector<uint32_t>> Rings(uint32_t v) const {
    std::vector<Edge> links;
    std::map<uint32_t, int> creases;
    for (const uint32_t id : around_.at(v)) {
      Corners t = updates_.triangles[id];
      std::rotate(t.begin(), std::find(t.begin(), t.end(), v), t.end());
      links.emplace_back(t[1], t[2]);
      for (const uint32_t w : {t[1], t[2]}) {
        if (Order(v, w) != 0) creases[w] = Order(v, w);
      }
    }
    if (links.empty() || (!creases.empty() && creases.size() != 2)) return {};
    if (!creases.empty() && creases.begin()->second != creases.rbegin()->second) return {};
    std::vector<std::vector<uint32_t>> rings;
    while (!links.empty()) {
      // From a crease, if there is any.
      auto link = std::ranges::find_if(links, [&](Edge e) { return creases.contains(e.first); });
      if (link == links.end()) link = links.begin();
      std::vector<uint32_t>& ring = rings.emplace_back(1, link->first);
      while (link != links.end()) {
        const uint32_t to = link->second;
        links.erase(link);
        if (to == ring[0]) break;
        ring.push_back(to);
        if (creases.contains(to)) break;
        link = std::ranges::find_if(links, [&](Edge e) { return e.first == to; });
      }
      if (creases.contains(ring.front()) != creases.contains(ring.back())) return {};
    }
    return creases.empty() && rings.size() > 1 ? std::vector<std::vector<uint32_t>>{} : rings;
  }

  // The triangles of a ring's polygon; nullopt when an edge of theirs is there, or among `made`.
  std::optional<std::vector<Corners>> Fill(const std::vector<uint32_t>& ring,
                                           std::set<Edge>& made) {
    const size_t k = ring.size();
    if (k < 3 || k > 9) return std::nullopt;
    bool creases_around = k == 3;
    for (size_t i = 0; i + 1 < k; ++i) creases_around &= Order(ring[i], ring[i + 1]) > 1;
    if (creases_around) return std::nullopt;
    const size_t turn = random_() % k;
    std::vector<Corners> triangles;
    const auto corner = [&](size_t i) { return ring[(turn + i) % k]; };
    for (size_t i = 1; i + 1 < k; ++i) {
      triangles.push_back({corner(0), corner(i), corner(i + 1)});
      if (i == 1) continue;
      const Edge edge = Between(corner(0), corner(i));
      if (Uses(edge.first, edge.second) + Uses(edge.second, edge.first) > 0) return std::nullopt;
      if (!made.insert(edge).second) return std::nullopt;
    }
    return triangles;
  }

  // Returns whether it removed the vertex.
  bool Remove(uint32_t v) {
    const std::vector<std::vector<uint32_t>> rings = Rings(v);
    if (rings.empty()) return false;
    const bool open = Order(v, rings[0].front()) != 0;
    std::set<Edge> made;
    if (open) {
      const auto [a, b] = Between(rings[0].front(), rings[0].back());
      made.insert({a, b});
      if (Uses(a, b) + Uses(b, a) > 0) return false;
    } else if (rings[0].size() == 3) {
      return false;
    }
    std::vector<Corners> holes;
    size_t corners = 0;
    for (const std::vector<uint32_t>& ring : rings) {
      corners += ring.size();
      if (rings.size() > 1 && corners > kMostFanCorners) return false;
      const std::optional<std::vector<Corners>> triangles = Fill(ring, made);
      if (!triangles) return false;
      holes.insert(holes.end(), triangles->begin(), triangles->end());
    }
    ClusterUpdates::Node node;
    node.vertex = v;
    node.error_code = static_cast<uint8_t>(110 + random_() % 24);
    node.star_begin = static_cast<uint32_t>(updates_.stars.size());
    node.hole_begin = static_cast<uint32_t>(updates_.holes.size());
    node.hole_count = static_cast<uint32_t>(holes.size());
    node.fans = open && rings.size() > 1 ? static_cast<uint32_t>(rings.size()) : 0;
    const std::set<uint32_t> star = around_[v];
    node.star_count = static_cast<uint32_t>(star.size());
    updates_.stars.insert(updates_.stars.end(), star.begin(), star.end());
    for (const uint32_t id : star) Erase(id);
    for (const Corners& t : holes) {
      updates_.holes.push_back(static_cast<uint32_t>(updates_.triangles.size()));
      Add(t);
    }
    updates_.nodes.push_back(node);
    return true;
  }

  const ClusterOptions& options_;
  ClusterUpdates& updates_;
  std::mt19937 random_;
  std::map<uint32_t, std::set<uint32_t>> around_;
  std::map<Edge, int> uses_;  // directed edges
};

}  // namespace

void MakeBook(const ClusterOptions& options, ClusterUpdates& updates) {
  Book(options, updates).Run();
}

}  // namespace mtdb::testing
