// SPDX-License-Identifier: Apache-2.0
#include "tests/codecs/update_fixture.h"

#include <algorithm>

#include "store/base/hash.h"
#include "tests/support/client_mesh_check.h"

namespace mtdb::testing {

void Damage(std::mt19937& random, Bytes* body) {
  if (random() % 2 == 0) {
    (*body)[random() % body->size()] ^= static_cast<std::byte>(1 << random() % 8);
  }
  if (random() % 8 == 0) body->resize(1 + random() % body->size());
}

Bytes UpdateRecord(ByteSpan body) {
  ByteWriter record;
  record.bytes().reserve(body.size() + 16);
  record.PutVarint(body.size());
  record.Put<uint32_t>(static_cast<uint32_t>(Hash64(body)));
  record.PutBytes(body);
  return record.Take();
}

UpdateFixture::UpdateFixture(const ClusterOptions& options) : UpdateFixture(MakeCluster(options)) {
  terrain_ = options.surface == Surface::kTerrain;
}

UpdateFixture::UpdateFixture(const ClusterFixture& fixture) {
  attributes_ = fixture.attributes;
  const EncodedCluster encoded = EncodeCluster(fixture.updates, attributes_);
  cluster_ = *DecodeCluster(encoded.payload, MakeIn(fixture, encoded), attributes_,
                            static_cast<uint32_t>(fixture.updates.nodes.size()), "fixture");
  creator_.assign(cluster_.slots(), kNone32);
  for (uint32_t i = 0; i < cluster_.nodes(); ++i) {
    for (uint32_t s = cluster_.star_begin[i]; s < cluster_.star_begin[i + 1]; ++s) creator_[s] = i;
  }
  const size_t row = attributes_.row_bytes();
  for (uint32_t v = 0; v < cluster_.external_vertices(); ++v) {
    base_.vertices.push_back(v);
    base_.positions.push_back(cluster_.position(v));
  }
  base_.rows.assign(
      cluster_.in.rows.begin(),
      cluster_.in.rows.begin() + static_cast<std::ptrdiff_t>(row * cluster_.external_vertices()));
  for (uint32_t s = 0; s < cluster_.in_triangles(); ++s) {
    base_.triangles.push_back(cluster_.in.triangles[s]);
    base_.triangle_keys.push_back(s);
  }
}

std::vector<uint32_t> UpdateFixture::Parents(uint32_t node) const {
  std::vector<uint32_t> parents;
  for (const uint32_t slot : cluster_.hole(node)) {
    if (creator_[slot] != kNone32) parents.push_back(creator_[slot]);
  }
  return parents;
}

std::vector<bool> UpdateFixture::Closed(std::vector<bool> wanted) const {
  for (uint32_t i = cluster_.nodes(); i-- > 0;) {
    if (!wanted[i]) continue;
    for (const uint32_t p : Parents(i)) wanted[p] = true;
  }
  return wanted;
}

std::array<uint32_t, 3> UpdateFixture::Corners(uint32_t slot) const {
  if (slot < cluster_.in_triangles()) return cluster_.in.triangles[slot];
  return cluster_.created_triangle(creator_[slot], slot);
}

void UpdateFixture::AddNode(uint32_t node, UpdateBatch& batch) const {
  // A fan ends where a later one begins, or the node's star.
  uint32_t begin = cluster_.star_begin[node];
  const uint32_t end = cluster_.star_begin[node + 1];
  const std::span<const uint32_t> hole = cluster_.hole(node);
  size_t done = 0;
  std::vector<uint32_t> ends;
  for (const uint32_t slot : cluster_.later_fans) {
    if (slot > begin && slot < end) ends.push_back(slot);
  }
  ends.push_back(end);
  for (const uint32_t fan_end : ends) {
    std::vector<uint32_t> ring;
    for (uint32_t slot = begin; slot < fan_end; ++slot) {
      const auto corners = cluster_.created_triangle(node, slot);
      if (ring.empty()) ring.push_back(corners[1]);
      if (corners[2] != ring[0]) ring.push_back(corners[2]);
    }
    AddHole(node, begin, ring, hole.subspan(done, ring.size() - 2), batch);
    batch.nodes.back().twin = done > 0;
    done += ring.size() - 2;
    begin = fan_end;
  }
}

void UpdateFixture::AddHole(uint32_t node, uint32_t first_star, std::span<const uint32_t> ring,
                            std::span<const uint32_t> hole, UpdateBatch& batch) const {
  UpdateBatch::Node& out = batch.nodes.emplace_back();
  const uint32_t vertex = cluster_.external_vertices() + node;
  out.vertex = vertex;
  out.position = cluster_.position(vertex);
  out.boundary = cluster_.boundary(node);
  out.first_star = first_star;
  out.ring_begin = static_cast<uint32_t>(batch.ring.size());
  out.hole_begin = static_cast<uint32_t>(batch.holes.size());
  out.ring_count = static_cast<uint32_t>(ring.size());
  batch.ring.insert(batch.ring.end(), ring.begin(), ring.end());
  for (const uint32_t slot : hole) {
    UpdateBatch::HoleTriangle& t = batch.holes.emplace_back();
    t.key = slot;
    const auto corners = Corners(slot);
    for (size_t c = 0; c < 3; ++c) {
      t.corners[c] =
          static_cast<uint8_t>(std::find(ring.begin(), ring.end(), corners[c]) - ring.begin());
    }
  }
  const size_t row = attributes_.row_bytes();
  const auto begin = cluster_.in.rows.begin() + static_cast<std::ptrdiff_t>(vertex * row);
  batch.rows.insert(batch.rows.end(), begin, begin + static_cast<std::ptrdiff_t>(row));
}

std::vector<UpdateBatch> UpdateFixture::Batches(const std::vector<bool>& from,
                                                const std::vector<bool>& to) const {
  std::vector<UpdateBatch> batches;
  const uint32_t nodes = cluster_.nodes();
  const auto collect = [&](const std::vector<bool>& has, const std::vector<bool>& lacks,
                           bool insert) {
    const size_t first = batches.size();
    std::vector<size_t> level(nodes, 0);
    for (uint32_t n = 0; n < nodes; ++n) {
      const uint32_t i = insert ? n : nodes - 1 - n;
      if (!has[i] || lacks[i]) continue;
      for (const uint32_t p : Parents(i)) {
        if (!has[p] || lacks[p]) continue;
        size_t& later = level[insert ? i : p];
        later = std::max(later, level[insert ? p : i] + 1);
      }
      while (batches.size() <= first + level[i]) batches.emplace_back().insert = insert;
      AddNode(i, batches[first + level[i]]);
    }
  };
  collect(from, to, false);
  collect(to, from, true);
  return batches;
}

std::multiset<std::string> UpdateFixture::Triangles(const std::vector<bool>& applied,
                                                    const MeetsRegion& region) const {
  std::multiset<std::string> set;
  const size_t row = attributes_.row_bytes();
  const auto row_of = [&](uint32_t v) { return ByteSpan(cluster_.in.rows).subspan(v * row, row); };
  for (uint32_t s = 0; s < cluster_.slots(); ++s) {
    const uint32_t remover = cluster_.removers[s];
    if (creator_[s] != kNone32 && !applied[creator_[s]]) continue;
    if (RemovedByNode(remover) && applied[remover]) continue;
    const auto c = Corners(s);
    const auto at = [&](size_t i) { return options(0).grid.Position(cluster_.position(c[i])); };
    if (region && !region({at(0), at(1), at(2)})) continue;
    set.insert(
        TriangleText({cluster_.position(c[0]), cluster_.position(c[1]), cluster_.position(c[2])},
                     {row_of(c[0]), row_of(c[1]), row_of(c[2])}));
  }
  return set;
}

}  // namespace mtdb::testing
