// SPDX-License-Identifier: Apache-2.0
#include "codecs/stream/encode/update_sender.h"

#include <algorithm>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "codecs/stream/internal/memory_bytes.h"
#include "store/base/attribute_layout.h"
#include "store/base/check.h"
#include "store/base/hash.h"

namespace mtdb {

using namespace internal;

namespace {

// Whether the Delaunay rule may be used, as IsPlace has it, with room for borders that move.
ClientMeshOptions Settled(ClientMeshOptions options, const BaseMesh& base) {
  const auto fits = [](Vec3i p) {
    return std::max(std::abs(int64_t{p.x}), std::abs(int64_t{p.y})) <= kMaxPlace / 2;
  };
  options.delaunay = options.delaunay && options.grid.mode == PositionMode::kRaster &&
                     std::all_of(base.positions.begin(), base.positions.end(), fits);
  return options;
}

// More than are removed.
size_t Inserted(std::span<const UpdateBatch> batches) {
  size_t inserted = 0;
  size_t removed = 0;
  for (const UpdateBatch& batch : batches) {
    (batch.insert ? inserted : removed) += batch.updates();
  }
  return inserted > removed ? inserted - removed : 0;
}

void PutGrid(const Grid& grid, ByteWriter* w) {
  w->Put<uint8_t>(static_cast<uint8_t>(grid.mode));
  for (int i = 0; i < 3; ++i) w->Put<double>(grid.origin[i]);
  w->Put<double>(grid.step);
  if (grid.mode != PositionMode::kRaster) return;
  for (const double v : grid.plane) w->Put<double>(v);
}

}  // namespace

UpdateSender::UpdateSender(const ClientMeshOptions& options, const BaseMesh& base,
                           const MeetsRegion& region)
    : s_(Settled(options, base)) {
  MTDB_CHECK(base.positions.size() == base.vertices.size() &&
                 base.triangle_keys.size() == base.triangles.size() &&
                 base.rows.size() == base.vertices.size() * s_.row_bytes,
             "the parts of a base mesh have different lengths");
  Box3d box;
  for (const Vec3i p : base.positions) box.Add(options.grid.Position(p));
  const Vec3d origin = base.positions.empty() ? Vec3d{} : (box.min + box.max) * 0.5;
  if (!region) {
    WriteStart(base, origin);
    return;
  }
  // An empty mesh, to which what meets the region is attached.
  s_.whole.emplace(options, base);
  s_.whole->Choose(region);
  WriteStart({}, origin);
  ByteWriter attached;
  clips_.Encode(attached);
  start_.insert(start_.end(), attached.bytes().begin(), attached.bytes().end());
}

bool UpdateSender::NotesLawful(std::span<const UpdateBatch> batches) {
  if (!lawful_) return false;
  bool keeps_border = false;
  lawful_ = rule_.Note(batches, &keeps_border);
  if (lawful_ && keeps_border) return true;
  rule_.Clear();
  return false;
}

// Vertices go in the order in which the triangles name them.
void UpdateSender::WriteStart(const BaseMesh& base, Vec3d origin) {
  std::vector<uint32_t> number(base.vertices.size(), kNone32);
  std::vector<Vec3i> positions;
  Bytes rows;
  std::vector<std::array<uint32_t, 3>> triangles;
  ByteWriter indices;
  for (const auto& t : base.triangles) {
    auto& corners = triangles.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      uint32_t& v = number[t[c]];
      const auto used = static_cast<uint32_t>(positions.size());
      indices.PutVarint(v == kNone32 ? 0 : used - v);
      if (v == kNone32) {
        v = used;
        positions.push_back(base.positions[t[c]]);
        const auto row = base.rows.begin() + static_cast<std::ptrdiff_t>(t[c] * s_.row_bytes);
        rows.insert(rows.end(), row, row + static_cast<std::ptrdiff_t>(s_.row_bytes));
        s_.vertices.Put(base.vertices[t[c]], v);
      }
      corners[c] = v;
    }
  }
  ByteWriter body;
  body.bytes().reserve(256 + 8 * positions.size() + indices.size() + rows.size());
  PutGrid(s_.options.grid, &body);
  body.Put<uint8_t>(s_.options.delaunay ? 1 : 0);
  for (int i = 0; i < 3; ++i) body.Put<double>(origin[i]);
  PutAttributeLayout(s_.options.attributes, &body);
  body.PutVarint(s_.options.remembered_vertices);
  body.PutVarint(positions.size());
  body.PutVarint(triangles.size());
  Vec3i last{};
  for (const Vec3i p : positions) {
    for (int i = 0; i < 3; ++i) {
      body.PutVarint(ZigZag(static_cast<uint32_t>(p[i]) - static_cast<uint32_t>(last[i])));
    }
    last = p;
  }
  body.PutBytes(indices.bytes());
  body.PutBytes(SplitPlanes(rows, s_.row_bytes));

  MTDB_CHECK(body.size() <= UpdateEncoder::kMaxStartBytes,
             "a base mesh is too long for a stream's start");
  ByteWriter start;
  for (const char c : kUpdateMagic) start.Put(c);
  start.Put<uint8_t>(kUpdateVersion);
  start.PutVarint(body.size());
  start.Put<uint32_t>(static_cast<uint32_t>(Hash64(body.bytes())));
  start.PutBytes(body.bytes());
  start_ = start.Take();

  s_.mesh.Start(origin, positions, rows, triangles);
  s_.sent = positions.size();
  s_.models.reference = UpdateReference(s_.mesh);
  for (size_t t = 0; t < triangles.size(); ++t) {
    s_.PutTriangle(base.triangle_keys[t], static_cast<uint32_t>(t));
  }
  lawful_ = s_.options.delaunay && !s_.whole && rule_.IsMeshLawful();
}

Bytes UpdateSender::Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region) {
  ByteWriter out;
  if (!region && !s_.whole && NotesLawful(batches)) {
    rule_.Encode(out);
    s_.EndRecord(out);
    return out.Take();
  }
  if (region) lawful_ = false;
  if (region && !s_.whole) clips_.Begin();
  EncodeBatches(batches, region, out);
  if (s_.whole) clips_.Encode(out);
  if (!region && s_.whole) {
    s_.whole.reset();
    lawful_ = s_.options.delaunay && rule_.IsMeshLawful();
  }
  batches_.ForgetBatch();
  return out.Take();
}

void UpdateSender::EncodeBatches(std::span<const UpdateBatch> batches, const MeetsRegion& region,
                                 ByteWriter& out) {
  std::vector<BatchEncoder::Follows> plan(batches.size());
  if (s_.whole) {
    for (const UpdateBatch& batch : batches) s_.whole->Apply(batch);
    s_.whole->Choose(region);
    plan = s_.whole->Plan(batches, s_.triangles);
  } else {
    s_.mesh.ExpectMore(Inserted(batches));
  }
  for (size_t b = 0; b < batches.size(); ++b) {
    batches_.Encode(batches[b], plan[b], out);
    if (s_.has_enough() || (b + 1 == batches.size() && !s_.whole)) s_.EndRecord(out);
  }
}

size_t UpdateSender::memory_bytes() const {
  return sizeof(*this) + s_.mesh.memory_bytes() + (s_.whole ? s_.whole->memory_bytes() : 0) +
         s_.triangles.memory_bytes() + s_.vertices.memory_bytes() + CapacityBytes(start_) +
         batches_.memory_bytes();
}

class UpdateEncoder::Impl : public UpdateSender {
 public:
  using UpdateSender::UpdateSender;
  const ClientMesh mesh{stream().mesh};
};

UpdateEncoder::UpdateEncoder(const ClientMeshOptions& options, const BaseMesh& base,
                             const MeetsRegion& region)
    : impl_(std::make_unique<Impl>(options, base, region)) {}
UpdateEncoder::~UpdateEncoder() = default;
uint64_t UpdateEncoder::StartBytes(const ClientMeshOptions& options, const BaseMesh& base) {
  constexpr uint64_t kLongestVarint = 5;
  uint64_t bytes =
      256 + base.rows.size() + 3 * kLongestVarint * (base.positions.size() + base.triangles.size());
  for (const VertexAttribute& a : options.attributes.attributes) bytes += a.name.size() + 24;
  return bytes;
}
const Bytes& UpdateEncoder::start() const { return impl_->start(); }
Bytes UpdateEncoder::Encode(std::span<const UpdateBatch> batches, const MeetsRegion& region) {
  return impl_->Encode(batches, region);
}
const ClientMesh& UpdateEncoder::mesh() const { return impl_->mesh; }
uint64_t UpdateEncoder::listed_updates() const { return impl_->listed(); }
size_t UpdateEncoder::memory_bytes() const { return impl_->memory_bytes(); }
uint64_t UpdateEncoder::sent_vertices() const { return impl_->stream().sent; }
uint64_t UpdateEncoder::recalled_vertices() const { return impl_->stream().recalled; }

}  // namespace mtdb
