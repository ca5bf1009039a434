// SPDX-License-Identifier: Apache-2.0
// SheetGraph: where the sheets of a complex end, meet and touch. By sorting and counting alone, so
// that it can judge what others make of the complex.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/sheets/complex.h"

namespace mtdb::sheets {

// A triangle, or two that are the exact opposite of each other.
struct Sheet {
  Triangle corners{};
  bool two_sided = false;
};

// How many sheets have an edge: one-sided ones that run along it, against it, and two-sided ones.
struct Signature {
  uint32_t along = 0, against = 0, two_sided = 0;

  // Two sheets that go on in each other.
  bool regular() const {
    return (along == 1 && against == 1 && two_sided == 0) ||
           (along == 0 && against == 0 && two_sided == 2);
  }
  uint32_t faces() const { return along + against + 2 * two_sided; }
  Signature Flipped() const { return {against, along, two_sided}; }
  friend bool operator==(const Signature&, const Signature&) = default;
};
std::string Text(const Signature& signature);  // "2+ 1- 0="

struct Edge {
  uint32_t a = 0, b = 0;  // a < b
  Signature signature;    // from a to b
  uint32_t first = 0;     // in SheetGraph::sheets_of_edges
  uint32_t count = 0;
};

// A path of creases through vertices that have two creases each, of one signature.
struct Chain {
  std::vector<uint32_t> vertices;  // of a closed one each once
  bool closed = false;
  Signature signature;  // in the direction of `vertices`
};

class SheetGraph {
 public:
  explicit SheetGraph(const Complex& complex);
  // Of sheets that another graph found, of a complex of so many points.
  SheetGraph(std::vector<Sheet> sheets, size_t points);

  const std::vector<Sheet>& sheets() const { return sheets_; }
  const std::vector<Edge>& edges() const { return edges_; }
  const Edge* FindEdge(uint32_t a, uint32_t b) const;  // nullptr when there is none
  const std::vector<Chain>& chains() const { return chains_; }
  // Ends of chains; closed chains have none.
  bool IsNode(uint32_t v) const { return is_node_[v]; }
  bool IsUsed(uint32_t v) const { return star_parts_[v] != 0; }
  // Into how many parts the sheets around a vertex fall that are joined by edges.
  uint32_t star_parts(uint32_t v) const { return star_parts_[v]; }

  // A patch is what hangs together across edges that are no creases.
  uint32_t patch_count() const { return patch_count_; }
  uint32_t patch_of(size_t sheet) const { return patch_of_[sheet]; }
  const std::vector<uint32_t>& patches_at(uint32_t v) const { return patches_at_[v]; }  // sorted

  uint64_t components() const { return components_; }
  int64_t euler() const { return euler_; }
  // What the complex had more than once in one orientation, or with two equal corners.
  uint64_t duplicates() const { return duplicates_; }
  uint64_t degenerates() const { return degenerates_; }
  uint64_t opposite_pairs() const { return opposite_pairs_; }

 private:
  void FindSheets(const Complex& complex);
  void Finish(size_t points);
  void FindEdges();
  void FindPatches(size_t points);
  void FindStars(size_t points);
  void FindChains(size_t points);
  Chain Follow(uint32_t from, uint32_t over, std::vector<bool>* done) const;
  Signature Towards(const Edge& edge, uint32_t to) const {
    return edge.b == to ? edge.signature : edge.signature.Flipped();
  }

  std::vector<Sheet> sheets_;
  std::vector<Edge> edges_;
  std::vector<uint32_t> sheets_of_edges_;
  std::vector<std::vector<uint32_t>> creases_at_;  // per vertex, edges
  std::vector<Chain> chains_;
  std::vector<bool> is_node_;
  std::vector<uint32_t> star_parts_;
  std::vector<uint32_t> patch_of_;
  std::vector<std::vector<uint32_t>> patches_at_;
  uint32_t patch_count_ = 0;
  uint64_t components_ = 0;
  int64_t euler_ = 0;
  uint64_t duplicates_ = 0, degenerates_ = 0, opposite_pairs_ = 0;
};

}  // namespace mtdb::sheets
