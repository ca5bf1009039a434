// SPDX-License-Identifier: Apache-2.0
#include "tests/sheets/cut_check.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <map>
#include <set>
#include <tuple>

#include "tests/sheets/sheet_graph.h"

namespace mtdb::sheets {
namespace {

constexpr size_t kMostComplaints = 20;
// Nobody can say what is inside of a patch that is flat or crumpled: one whose volume is less than
// this part of its area to the power of 3/2, which is 0.094 for a sphere and 0.052 for a regular
// tetrahedron, or that has lost most of its volume.
constexpr double kSolid = 0.035, kMostOfVolume = 0.5;

double Dot(const Point& a, const Point& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Point Minus(const Point& a, const Point& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Point Cross(const Point& a, const Point& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

std::string Name(uint32_t v) { return std::to_string(v); }

// The patches that have all three corners.
std::vector<uint32_t> PatchesOf(const SheetGraph& graph, const Triangle& t) {
  std::vector<uint32_t> two, three;
  std::set_intersection(graph.patches_at(t[0]).begin(), graph.patches_at(t[0]).end(),
                        graph.patches_at(t[1]).begin(), graph.patches_at(t[1]).end(),
                        std::back_inserter(two));
  std::set_intersection(two.begin(), two.end(), graph.patches_at(t[2]).begin(),
                        graph.patches_at(t[2]).end(), std::back_inserter(three));
  return three;
}

// The corners of each patch.
std::vector<std::vector<uint32_t>> CornersOfPatches(const SheetGraph& graph, size_t points) {
  std::vector<std::vector<uint32_t>> corners(graph.patch_count());
  for (uint32_t v = 0; v < points; ++v) {
    for (const uint32_t patch : graph.patches_at(v)) corners[patch].push_back(v);
  }
  return corners;
}

class CutChecker {
 public:
  CutChecker(const Complex& complex, const Complex& cut, const CutCheckOptions& options)
      : points_(complex.points), whole_(complex), options_(options) {
    Number(complex, cut);
  }
  CutReport Check() {
    if (!report_.ok()) return report_;
    const SheetGraph cut(renumbered_);
    Require(cut.duplicates() == 0, std::to_string(cut.duplicates()) + " faces stand there twice");
    Require(cut.degenerates() == 0, std::to_string(cut.degenerates()) + " degenerate faces");
    const SheetGraph rest = options_.patches_may_vanish ? Rest(cut) : whole_;
    CheckFaces(rest, cut);
    CheckChains(rest, cut);
    CheckStars(rest, cut);
    CheckCounts(rest, cut);
    CheckSides(rest, cut);
    return report_;
  }

 private:
  void Require(bool good, const std::string& complaint) {
    if (!good && report_.complaints.size() < kMostComplaints)
      report_.complaints.push_back(complaint);
  }
  void Number(const Complex& complex, const Complex& cut);
  SheetGraph Rest(const SheetGraph& cut);
  static std::vector<bool> Present(const SheetGraph& rest, const SheetGraph& cut, size_t points);
  // Patches of which the cut has no face; not yet all of them, when some have neighbours.
  std::vector<bool> Vanished(const SheetGraph& rest, const SheetGraph& cut) const;
  void CheckFaces(const SheetGraph& rest, const SheetGraph& cut);
  void CheckChains(const SheetGraph& rest, const SheetGraph& cut);
  void CheckStars(const SheetGraph& rest, const SheetGraph& cut);
  void CheckCounts(const SheetGraph& rest, const SheetGraph& cut);
  void CheckSides(const SheetGraph& rest, const SheetGraph& cut);
  struct Solid {
    double volume = 0, area = 0;
  };
  std::map<uint32_t, Solid> Solids(const SheetGraph& graph) const;

  const std::vector<Point>& points_;
  const SheetGraph whole_;
  const CutCheckOptions options_;
  Complex renumbered_;  // the cut with the numbers of the complex
  CutReport report_;
};

void CutChecker::Number(const Complex& complex, const Complex& cut) {
  std::map<Point, uint32_t> number;
  for (uint32_t v = 0; v < complex.points.size(); ++v) {
    if (!whole_.IsUsed(v)) continue;
    Require(number.emplace(complex.points[v], v).second,
            "vertex " + Name(v) + " of the complex has the position of another one");
  }
  std::vector<uint32_t> of_cut;
  std::set<uint32_t> seen;
  for (uint32_t v = 0; v < cut.points.size(); ++v) {
    const auto at = number.find(cut.points[v]);
    Require(at != number.end(), "vertex " + Name(v) + " of the cut is none of the complex");
    of_cut.push_back(at == number.end() ? 0 : at->second);
    Require(at == number.end() || seen.insert(at->second).second,
            "vertex " + Name(of_cut.back()) + " is there twice");
  }
  renumbered_.points = complex.points;
  for (const Triangle& t : cut.triangles) {
    const bool good = std::max({t[0], t[1], t[2]}) < of_cut.size();
    Require(good, "a face names a vertex that is not there");
    if (good) renumbered_.triangles.push_back({of_cut[t[0]], of_cut[t[1]], of_cut[t[2]]});
  }
}

std::vector<bool> TwoSidedPatches(const SheetGraph& graph) {
  std::vector<bool> two_sided(graph.patch_count());
  for (size_t s = 0; s < graph.sheets().size(); ++s) {
    two_sided[graph.patch_of(s)] = graph.sheets()[s].two_sided;
  }
  return two_sided;
}

// Patches without which a surface would have a hole: of the one-sided sheets at an edge, those that
// run one way would outnumber the others by more than they do.
std::vector<bool> ClosingPatches(const SheetGraph& graph) {
  std::vector<bool> closing(graph.patch_count());
  std::map<std::tuple<uint32_t, uint32_t, uint32_t>, int> share;  // of a patch at an edge
  for (size_t s = 0; s < graph.sheets().size(); ++s) {
    if (graph.sheets()[s].two_sided) continue;
    const Triangle& t = graph.sheets()[s].corners;
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t a = t[i], b = t[(i + 1) % 3];
      share[{graph.patch_of(s), std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
    }
  }
  for (const auto& [at, part] : share) {
    const auto& [patch, a, b] = at;
    const Signature& all = graph.FindEdge(a, b)->signature;
    const int sum = static_cast<int>(all.along) - static_cast<int>(all.against);
    if (std::abs(sum - part) > std::abs(sum)) closing[patch] = true;
  }
  return closing;
}

// A patch of the cut belongs to a patch that has the corners of all its faces, and is two-sided as
// they are. Where two patches became one there is none, and then each face that has one patch only
// says that it is there. A patch is there whose own vertex is.
std::vector<bool> CutChecker::Present(const SheetGraph& rest, const SheetGraph& cut,
                                      size_t points) {
  std::vector<bool> present(rest.patch_count());
  const std::vector<bool> two_sided = TwoSidedPatches(rest);
  for (uint32_t v = 0; v < points; ++v) {
    if (cut.IsUsed(v) && rest.patches_at(v).size() == 1) present[rest.patches_at(v)[0]] = true;
  }
  std::vector<std::vector<uint32_t>> common(cut.patch_count()), sole(cut.patch_count());
  std::vector<bool> begun(cut.patch_count());
  for (size_t s = 0; s < cut.sheets().size(); ++s) {
    std::vector<uint32_t> patches = PatchesOf(rest, cut.sheets()[s].corners);
    std::erase_if(patches, [&](uint32_t p) { return two_sided[p] != cut.sheets()[s].two_sided; });
    const uint32_t own = cut.patch_of(s);
    if (patches.size() == 1) sole[own].push_back(patches[0]);
    std::vector<uint32_t> both;
    std::set_intersection(patches.begin(), patches.end(), common[own].begin(), common[own].end(),
                          std::back_inserter(both));
    common[own] = begun[own] ? both : patches;
    begun[own] = true;
  }
  for (uint32_t own = 0; own < cut.patch_count(); ++own) {
    for (const uint32_t patch : common[own].empty() ? sole[own] : common[own]) {
      present[patch] = true;
    }
  }
  return present;
}

// Flaps, fins and components have vertices of their own, and surfaces are not opened without need.
// Others may seem to be gone while a neighbour was there that is gone now; so they are asked last.
std::vector<bool> CutChecker::Vanished(const SheetGraph& rest, const SheetGraph& cut) const {
  std::vector<bool> vanished = Present(rest, cut, points_.size());
  vanished.flip();
  std::vector<bool> has_own(rest.patch_count());
  for (uint32_t v = 0; v < points_.size(); ++v) {
    if (rest.patches_at(v).size() == 1) has_own[rest.patches_at(v)[0]] = true;
  }
  const std::vector<bool> closing = ClosingPatches(rest);
  const auto prefer = [&](auto&& wanted) {
    std::vector<bool> first = vanished;
    for (uint32_t patch = 0; patch < rest.patch_count(); ++patch) {
      if (!wanted(patch)) first[patch] = false;
    }
    if (std::count(first.begin(), first.end(), true) == 0) return false;
    vanished = first;
    return true;
  };
  prefer([&](uint32_t patch) { return has_own[patch] && !closing[patch]; }) ||
      prefer([&](uint32_t patch) { return !closing[patch]; }) ||
      prefer([&](uint32_t patch) { return has_own[patch]; });
  // Of neighbours the smaller one.
  const std::vector<std::vector<uint32_t>> corners = CornersOfPatches(rest, points_.size());
  std::vector<bool> smallest = vanished;
  for (uint32_t patch = 0; patch < rest.patch_count(); ++patch) {
    for (const uint32_t v : corners[patch]) {
      for (const uint32_t other : rest.patches_at(v)) {
        const bool smaller =
            std::pair(corners[other].size(), other) < std::pair(corners[patch].size(), patch);
        if (vanished[other] && smaller) smallest[patch] = false;
      }
    }
  }
  return smallest;
}

SheetGraph CutChecker::Rest(const SheetGraph& cut) {
  SheetGraph rest = whole_;
  for (;;) {
    const std::vector<bool> vanished = Vanished(rest, cut);
    const auto count = std::count(vanished.begin(), vanished.end(), true);
    if (count == 0) break;
    report_.vanished_patches += static_cast<uint64_t>(count);
    std::vector<Sheet> left;
    for (size_t s = 0; s < rest.sheets().size(); ++s) {
      if (!vanished[rest.patch_of(s)]) left.push_back(rest.sheets()[s]);
    }
    // Two patches may become one when a third one that ended between them has gone.
    rest = SheetGraph(std::move(left), points_.size());
  }
  for (uint32_t v = 0; v < points_.size(); ++v) {
    report_.vanished_vertices += whole_.IsUsed(v) && !rest.IsUsed(v);
  }
  return rest;
}

void CutChecker::CheckFaces(const SheetGraph& rest, const SheetGraph& cut) {
  const std::vector<bool> two_sided = TwoSidedPatches(rest);
  for (const Sheet& sheet : cut.sheets()) {
    const Triangle& t = sheet.corners;
    const std::string face = "face " + Name(t[0]) + " " + Name(t[1]) + " " + Name(t[2]);
    const std::vector<uint32_t> patches = PatchesOf(rest, t);
    Require(!patches.empty(), face + " joins several patches");
    Require(patches.empty() ||
                std::any_of(patches.begin(), patches.end(),
                            [&](uint32_t patch) { return two_sided[patch] == sheet.two_sided; }),
            face + (sheet.two_sided ? " has an opposite" : " lacks its opposite"));
  }
}

void CutChecker::CheckChains(const SheetGraph& rest, const SheetGraph& cut) {
  std::set<std::pair<uint32_t, uint32_t>> told;
  for (const Chain& chain : rest.chains()) {
    std::vector<uint32_t> path;
    for (const uint32_t v : chain.vertices) {
      if (cut.IsUsed(v)) path.push_back(v);
    }
    const uint32_t first = chain.vertices.front(), last = chain.vertices.back();
    const std::string name = "the chain from " + Name(first) + " to " + Name(last);
    if (chain.closed) {
      Require(path.size() >= 3, "of the closed chain of " + Name(first) + " less than 3 are left");
      if (path.size() < 3) continue;
      path.push_back(path.front());
    } else {
      const bool kept = cut.IsUsed(first) && cut.IsUsed(last);
      Require(kept, name + " has lost an end");
      if (!kept) continue;
    }
    for (size_t i = 0; i + 1 < path.size(); ++i) {
      const uint32_t a = path[i], b = path[i + 1];
      const std::string edge = "edge " + Name(a) + " " + Name(b) + " of " + name;
      const Edge* found = cut.FindEdge(a, b);
      Require(found != nullptr, edge + " is not there");
      Require(told.emplace(std::min(a, b), std::max(a, b)).second, edge + " is another's, too");
      if (found == nullptr) continue;
      const Signature here = a < b ? found->signature : found->signature.Flipped();
      Require(here == chain.signature,
              edge + " has " + Text(here) + " instead of " + Text(chain.signature));
    }
  }
  for (const Edge& edge : cut.edges()) {
    Require(edge.signature.regular() || told.contains({edge.a, edge.b}),
            "edge " + Name(edge.a) + " " + Name(edge.b) + " is no crease of the input and has " +
                Text(edge.signature));
  }
}

void CutChecker::CheckStars(const SheetGraph& rest, const SheetGraph& cut) {
  for (uint32_t v = 0; v < points_.size(); ++v) {
    if (rest.star_parts(v) > 1 || cut.IsUsed(v)) {
      Require(rest.star_parts(v) == cut.star_parts(v),
              std::to_string(cut.star_parts(v)) + " parts of sheets meet in vertex " + Name(v) +
                  " instead of " + std::to_string(rest.star_parts(v)));
    }
  }
}

void CutChecker::CheckCounts(const SheetGraph& rest, const SheetGraph& cut) {
  const auto same = [&](const char* what, auto expected, auto found) {
    Require(expected == found,
            std::to_string(found) + " " + what + " instead of " + std::to_string(expected));
  };
  same("components", rest.components(), cut.components());
  same("patches", rest.patch_count(), cut.patch_count());
  same("as Euler characteristic", rest.euler(), cut.euler());
}

// Of each one-sided patch that has no crease.
std::map<uint32_t, CutChecker::Solid> CutChecker::Solids(const SheetGraph& graph) const {
  std::vector<bool> closed(graph.patch_count(), true);
  for (size_t s = 0; s < graph.sheets().size(); ++s) {
    const Triangle& t = graph.sheets()[s].corners;
    for (size_t i = 0; i < 3; ++i) {
      const bool regular = graph.FindEdge(t[i], t[(i + 1) % 3])->signature.regular();
      if (!regular || graph.sheets()[s].two_sided) closed[graph.patch_of(s)] = false;
    }
  }
  std::map<uint32_t, Solid> solids;
  std::map<uint32_t, Point> origin;
  for (size_t s = 0; s < graph.sheets().size(); ++s) {
    const uint32_t patch = graph.patch_of(s);
    if (!closed[patch]) continue;
    const Triangle& t = graph.sheets()[s].corners;
    const Point& from = origin.emplace(patch, points_[t[0]]).first->second;
    const Point a = Minus(points_[t[0]], from), b = Minus(points_[t[1]], from);
    const Point c = Minus(points_[t[2]], from);
    solids[patch].volume += Dot(a, Cross(b, c)) / 6;
    const Point normal = Cross(Minus(b, a), Minus(c, a));
    solids[patch].area += std::sqrt(Dot(normal, normal)) / 2;
  }
  return solids;
}

void CutChecker::CheckSides(const SheetGraph& rest, const SheetGraph& cut) {
  const std::map<uint32_t, Solid> before = Solids(rest), after = Solids(cut);
  std::map<uint32_t, uint32_t> was;  // patches of the cut, and what they were
  for (size_t s = 0; s < cut.sheets().size(); ++s) {
    const std::vector<uint32_t> patches = PatchesOf(rest, cut.sheets()[s].corners);
    if (patches.size() == 1) was[cut.patch_of(s)] = patches[0];
  }
  for (const auto& [patch, solid] : after) {
    const auto at = was.contains(patch) ? before.find(was[patch]) : before.end();
    if (at == before.end()) continue;
    const auto& [volume, area] = at->second;
    if (std::abs(volume) < kSolid * std::pow(area, 1.5)) continue;
    if (std::abs(solid.volume) < kMostOfVolume * std::abs(volume)) continue;
    Require(solid.volume * volume > 0, "a closed patch is inside out");
  }
}

}  // namespace

std::string CutReport::Text() const {
  std::string text;
  for (const std::string& complaint : complaints) text += complaint + "\n";
  return text;
}

CutReport CheckCut(const Complex& complex, const Complex& cut, const CutCheckOptions& options) {
  return CutChecker(complex, cut, options).Check();
}

}  // namespace mtdb::sheets
