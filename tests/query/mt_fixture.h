// SPDX-License-Identifier: Apache-2.0
// Small Multi-Triangulations for tests, built by random legal vertex removals with random errors,
// once as a plain DAG in memory and once as clusters behind a ClusterSource.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <random>
#include <vector>

#include "store/cluster_source.h"

namespace mtdb::testing {

enum class Shape { kSphere, kTorus, kSheet, kTube };  // the last two have borders

struct MtOptions {
  Shape shape = Shape::kSphere;
  int resolution = 8;  // vertices along a side
  int rounds = 3;
  int tiles = 4;           // of the first round; later ones have fewer
  double keep = 0.3;       // share of vertices that a round aims to leave
  uint8_t code_max = 100;  // of random errors
  uint8_t code_min = 0;
  bool attributes = false;
  bool coincident = false;  // many positions tie, so that arcs are explicit
  uint32_t max_nodes = kNone32;
  int root_pieces = 2;
  uint32_t seed = 1;
};

// The plain DAG.
struct InMemoryMt {
  struct Triangle {
    std::array<uint32_t, 3> vertices;
    int creator = -1;  // node
    int remover = -1;  // node
  };
  struct Node {
    uint8_t code = 0;
    bool boundary = false;
    uint32_t vertex = 0;
    std::vector<uint32_t> hole;
    std::vector<uint32_t> star;
    UnitId cluster;
    NodeIndex index = 0;
  };
  std::vector<Vec3i> positions;
  std::vector<Triangle> triangles;
  std::vector<Node> nodes;  // parents have larger numbers
  std::vector<uint32_t> root_triangles;

  std::vector<int> Parents(int node) const;
  // Adds the node and its missing ancestors.
  void Close(int node, std::vector<bool>& applied) const;
  // Triangles of the cut.
  std::vector<uint32_t> Mesh(const std::vector<bool>& applied) const;
};

// Clusters in memory. Payloads may be tampered with, reads counted and made to fail.
class MemoryClusterSource final : public ClusterSource {
 public:
  const ObjectRecord& record() const override { return record_; }
  const ClusterIndex& index() const override { return index_; }
  void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) override;
  bool answers_at_once() const override { return true; }

  ObjectRecord record_;
  ClusterIndex index_;
  std::vector<Bytes> payloads_;  // by unit
  std::atomic<uint64_t> reads_{0};
  std::span<Bytes> cluster_payloads() { return std::span(payloads_).first(record_.clusters); }
  std::span<Bytes> root_payloads() { return std::span(payloads_).subspan(record_.clusters); }
  // Not null: decides each read (a failed Status) before it is served.
  std::function<Status(uint32_t unit)> on_read_;
};

struct MtFixture {
  InMemoryMt mt;
  Bytes rows;  // attributes per vertex of mt, as MtOptions::attributes says
  std::shared_ptr<MemoryClusterSource> source;

  Triangle3d Corners(const InMemoryMt::Triangle& t) const {
    const Grid& grid = source->record_.grid;
    return {grid.Position(mt.positions[t.vertices[0]]), grid.Position(mt.positions[t.vertices[1]]),
            grid.Position(mt.positions[t.vertices[2]])};
  }
};

MtFixture MakeMt(const MtOptions& options);
// A torus in five rounds.
MtFixture MakeTorus(int resolution, int tiles);

// Per node: whether a CutState has it.
template <typename Cut>
std::vector<bool> AppliedIn(const MtFixture& f, const Cut& cut) {
  std::vector<bool> applied;
  for (const InMemoryMt::Node& node : f.mt.nodes) {
    const auto* const u = cut.Find(node.cluster);
    applied.push_back(u != nullptr && u->applied.Test(node.index));
  }
  return applied;
}

}  // namespace mtdb::testing
