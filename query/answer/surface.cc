// SPDX-License-Identifier: Apache-2.0
#include "query/surface.h"

#include <algorithm>
#include <string>
#include <utility>

#include "query/answer/cut_impl.h"
#include "query/cache/cluster_cache.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

namespace {

// The index is trusted from here on: it must agree with the record and lead from larger ids to
// smaller ones only. Rows that come later are checked by the source.
Status CheckIndex(const ObjectRecord& record, const ClusterIndex& index) {
  const auto corrupt = [&](const std::string& what) {
    return Corrupt(record.name + ": cluster index: " + what);
  };
  if (index.cluster_count() != record.clusters || index.root_piece_count() != record.root_pieces) {
    return corrupt(std::to_string(index.cluster_count()) + " clusters and " +
                   std::to_string(index.root_piece_count()) +
                   " root pieces, but the catalog says " + std::to_string(record.clusters) +
                   " and " + std::to_string(record.root_pieces));
  }
  if (index.root_vertices() != record.root_vertices || index.root_vertices() >= kNone32) {
    return corrupt(std::to_string(index.root_vertices()) + " root vertices, but the catalog says " +
                   std::to_string(record.root_vertices));
  }
  if (index.unit_count() >= kChildFlag) return corrupt("too many clusters");
  VertexIndex next = index.root_vertices();
  bool all = true;
  for (UnitId id = 0; id < index.unit_count(); ++id) {
    all = all && index.Has(id);
    if (!all) continue;
    const std::string name = UnitLabel(record, id);
    const UnitEntry& unit = index.unit(id);
    if ((unit.nodes == 0) != (unit.round == kRootRound) || index.first_vertex(id) != next) {
      return corrupt(name + " has no nodes or the wrong first vertex");
    }
    next += unit.nodes;
    for (const UnitId p : index.parents(id)) {
      if (p <= id || p >= index.unit_count()) return corrupt(name + ": parent order");
    }
  }
  if ((all && next != record.vertex_numbers()) || record.vertices > record.vertex_numbers()) {
    return corrupt(std::to_string(next) + " numbers of vertices, but the catalog says " +
                   std::to_string(record.vertex_numbers()) + " for " +
                   std::to_string(record.vertices) + " vertices");
  }
  return Status::Ok();
}

}  // namespace

Surface::Surface(std::shared_ptr<ClusterSource> source, const SurfaceOptions& options)
    : source_(std::move(source)),
      cache_(std::make_unique<ClusterCache>(
          source_,
          CacheOptions{options.cache_bytes,
                       options.threads > 0 ? options.threads : ProcessorCount(), options.form,
                       options.waits, LoadUnit, options.tmp_directory, options.spill_bytes})) {}

Surface::~Surface() = default;

Surface::CacheUse Surface::cache_use() const { return {cache_->bytes(), cache_->decoded()}; }

Result<std::shared_ptr<Surface>> Surface::Open(std::shared_ptr<ClusterSource> source,
                                               const SurfaceOptions& options) {
  MTDB_CHECK(source != nullptr, "a surface needs a source");
  return CatchOutOfMemory([&]() -> Result<std::shared_ptr<Surface>> {
    MTDB_RETURN_IF_ERROR(CheckIndex(source->record(), source->index()));
    return std::shared_ptr<Surface>(new Surface(std::move(source), options));
  });
}

Result<Cut> Surface::Select(const Query& query) const {
  return CatchOutOfMemory([&]() -> Result<Cut> {
    auto impl = std::make_unique<CutImpl>(shared_from_this(), query, 0);
    MTDB_RETURN_IF_ERROR(impl->Select());
    return Cut(std::move(impl));
  });
}

Result<ExtractStats> Surface::Extract(const Query& query, MeshSink& sink) const {
  return CatchOutOfMemory([&]() -> Result<ExtractStats> {
    auto impl = std::make_unique<CutImpl>(shared_from_this(), query,
                                          sink.LargestRounding(CutImpl::HeaderOf(record())));
    MTDB_RETURN_IF_ERROR(impl->Select());
    MTDB_RETURN_IF_ERROR(impl->Emit(sink));
    return impl->stats();
  });
}

}  // namespace mtdb
