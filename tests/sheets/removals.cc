// SPDX-License-Identifier: Apache-2.0
#include "tests/sheets/removals.h"

#include <algorithm>
#include <map>
#include <set>

namespace mtdb::sheets {
namespace {

// Sheets around a vertex that go on in each other: the vertices that they pass, in the direction of
// the first one; of a whole turn each once.
struct Fan {
  std::vector<uint32_t> ring;
  bool closed = false;
  bool two_sided = false;
};

// A side of the star: a sheet with its corners after and before the vertex.
struct Side {
  uint32_t from = 0, to = 0;
  bool two_sided = false;
  bool used = false;
};

class Remover {
 public:
  Remover(const SheetGraph& graph, uint32_t v, std::mt19937& random)
      : graph_(graph), v_(v), random_(random) {}
  std::optional<std::vector<Sheet>> Remove();

 private:
  void Divide();
  bool IsCrease(uint32_t w) const { return !graph_.FindEdge(v_, w)->signature.regular(); }
  // Takes an unused side that has w and returns its other end; w where there is none.
  uint32_t Step(uint32_t w);
  bool Closable();
  bool Fill(const Fan& fan);

  const SheetGraph& graph_;
  const uint32_t v_;
  std::mt19937& random_;
  std::vector<Sheet> left_;  // first without the star, then with what fills it
  std::vector<Side> sides_;
  std::vector<Fan> fans_;
  std::set<std::pair<uint32_t, uint32_t>> fresh_;  // edges
};

uint32_t Remover::Step(uint32_t w) {
  for (Side& side : sides_) {
    if (side.used || (side.from != w && side.to != w)) continue;
    side.used = true;
    return side.from == w ? side.to : side.from;
  }
  return w;
}

void Remover::Divide() {
  for (const Sheet& sheet : graph_.sheets()) {
    const auto at = std::find(sheet.corners.begin(), sheet.corners.end(), v_);
    if (at == sheet.corners.end()) {
      left_.push_back(sheet);
      continue;
    }
    const auto i = static_cast<size_t>(at - sheet.corners.begin());
    sides_.push_back(
        {sheet.corners[(i + 1) % 3], sheet.corners[(i + 2) % 3], sheet.two_sided, false});
  }
  for (Side& first : sides_) {
    if (first.used) continue;
    first.used = true;
    Fan fan{{first.from, first.to}, false, first.two_sided};
    // On from the far end, then back from the near one, up to creases.
    for (const bool forward : {true, false}) {
      while (!fan.closed) {
        const uint32_t end = forward ? fan.ring.back() : fan.ring.front();
        if (IsCrease(end)) break;
        const uint32_t next = Step(end);
        fan.closed = next == (forward ? fan.ring.front() : fan.ring.back());
        if (!fan.closed) fan.ring.insert(forward ? fan.ring.end() : fan.ring.begin(), next);
      }
    }
    fans_.push_back(fan);
  }
}

// One whole turn, or half-disks between the same two creases whose chord is no edge.
bool Remover::Closable() {
  if (graph_.star_parts(v_) != 1 || graph_.IsNode(v_)) return false;
  if (fans_.size() == 1 && fans_[0].closed) return fans_[0].ring.size() >= 3;
  const uint32_t a = fans_[0].ring.front(), b = fans_[0].ring.back();
  if (a == b || graph_.FindEdge(a, b) != nullptr) return false;
  fresh_.insert(std::minmax(a, b));
  return std::all_of(fans_.begin(), fans_.end(), [&](const Fan& fan) {
    const uint32_t from = fan.ring.front(), to = fan.ring.back();
    return !fan.closed && fan.ring.size() >= 3 && std::minmax(from, to) == std::minmax(a, b);
  });
}

// All triangles have the ring's vertex `top`.
bool Remover::Fill(const Fan& fan) {
  const size_t n = fan.ring.size(), top = random_() % n;
  const auto ring = [&](size_t i) { return fan.ring[(top + i) % n]; };
  for (size_t i = 1; i + 1 < n; ++i) {
    const Sheet sheet{{ring(0), ring(i), ring(i + 1)}, fan.two_sided};
    const std::set<uint32_t> corners(sheet.corners.begin(), sheet.corners.end());
    for (const Sheet& other : left_) {
      if (corners == std::set<uint32_t>(other.corners.begin(), other.corners.end())) return false;
    }
    left_.push_back(sheet);
    if (i == 1) continue;
    const bool there = graph_.FindEdge(ring(0), ring(i)) != nullptr;
    if (there || !fresh_.insert(std::minmax(ring(0), ring(i))).second) return false;
  }
  return true;
}

std::optional<std::vector<Sheet>> Remover::Remove() {
  Divide();
  if (fans_.empty() || !Closable()) return std::nullopt;
  for (const Fan& fan : fans_) {
    if (!Fill(fan)) return std::nullopt;
  }
  return left_;
}

}  // namespace

std::optional<std::vector<Sheet>> RemoveVertex(const SheetGraph& graph, uint32_t v,
                                               std::mt19937& random) {
  return Remover(graph, v, random).Remove();
}

}  // namespace mtdb::sheets
