// SPDX-License-Identifier: Apache-2.0
// engine_digest < FILE: the query engine over an object that engine_dump wrote, in whatever the
// engine was compiled to: meshes of a few queries, and a session's moves, as one line of digests.
// The payloads come late, and nothing waits: what has come is handed in between two tries.
#include <cstdio>
#include <deque>
#include <memory>
#include <utility>

#include "query/session.h"
#include "query/surface.h"
#include "store/base/hash.h"
#include "store/records/index_codec.h"
#include "tests/codecs/decode_check/payload_file.h"

namespace mtdb {

using namespace internal;

namespace {

class PageSource final : public ClusterSource {
 public:
  static Result<std::shared_ptr<PageSource>> Read(ByteSpan file) {
    auto source = std::make_shared<PageSource>();
    ByteReader in(file);
    MTDB_ASSIGN_OR_RETURN(source->record_, DecodeObjectRecord(GetBlob(in), "record"));
    const ObjectRecord& r = source->record_;
    MTDB_RETURN_IF_ERROR(
        DecodeIndexRows(GetBlob(in), r.clusters + r.root_pieces, "index", &source->index_));
    source->index_.Finish(r.root_vertices);
    for (UnitId u = 0; u < source->index_.unit_count(); ++u) {
      const ByteSpan payload = GetBlob(in);
      source->payloads_.emplace_back(payload.begin(), payload.end());
    }
    if (in.failed()) return Corrupt("the file is cut short");
    return source;
  }

  const ObjectRecord& record() const override { return record_; }
  const ClusterIndex& index() const override { return index_; }
  void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) override {
    for (const UnitId u : units) asked_.emplace_back(u, receiver);
  }
  void Cancel(const PayloadReceiver& receiver) override {
    std::erase_if(asked_, [&](const auto& a) { return a.second.get() == &receiver; });
  }
  // What the page does when bytes have come; the last that was asked for comes first.
  bool Deliver(size_t count) {
    bool any = false;
    for (; count > 0 && !asked_.empty(); --count) {
      const auto [unit, receiver] = asked_.back();
      asked_.pop_back();
      receiver->Receive(unit, payloads_[unit]);
      any = true;
    }
    return any;
  }

 private:
  ObjectRecord record_;
  ClusterIndex index_;
  std::vector<Bytes> payloads_;
  std::deque<std::pair<UnitId, std::shared_ptr<PayloadReceiver>>> asked_;
};

uint64_t DigestOf(const TriangleMesh& mesh) {
  uint64_t digest = 0;
  const auto add = [&](const auto& list) {
    digest = Hash64(
        ByteSpan(reinterpret_cast<const std::byte*>(list.data()), list.size() * sizeof(list[0])),
        digest);
  };
  add(mesh.positions);
  for (const TriangleVertices& t : mesh.triangles) {
    for (const uint64_t v : t) digest = Mix64(digest ^ v);
  }
  add(mesh.rows);
  return digest;
}

// f() until all that it needs has come.
template <typename F>
auto UntilDone(PageSource& source, F&& f) -> decltype(f()) {
  for (;;) {
    auto result = f();
    if (result.status().code() != StatusCode::kNotYet || !source.Deliver(5)) return result;
  }
}

Status Run(ByteSpan file) {
  MTDB_ASSIGN_OR_RETURN(const auto source, PageSource::Read(file));
  SurfaceOptions options;
  options.waits = false;
  options.threads = 1;  // with nothing to deliver, nobody else is at work
  MTDB_ASSIGN_OR_RETURN(const auto surface, Surface::Open(source, options));
  const ObjectRecord& record = source->record();
  std::vector<Query> queries(3);
  queries[1].threshold = ConstantThreshold(0.003 * record.diagonal());
  queries[2].region = SphereRegion(record.bounds.min, 0.6 * record.diagonal());
  queries[2].threshold = ConstantThreshold(0.0005 * record.diagonal());
  queries[2].clip = true;
  for (const Query& query : {queries[1], queries[2], queries[0]}) {
    TriangleMesh mesh;
    MTDB_RETURN_IF_ERROR(UntilDone(*source, [&] {
                           mesh = {};
                           TriangleMeshSink sink(&mesh);
                           return surface->Extract(query, sink);
                         }).status());
    std::printf("%zu triangles %016llx; ", mesh.triangles.size(),
                static_cast<unsigned long long>(DigestOf(mesh)));
  }
  MTDB_ASSIGN_OR_RETURN(const auto session, Session::Open(surface));
  for (const size_t q : {size_t{1}, size_t{2}, size_t{1}}) {
    std::vector<UpdateBatch> batches;
    Query query = queries[q];
    query.clip = false;
    MTDB_RETURN_IF_ERROR(
        UntilDone(*source, [&] { return session->Update(query, &batches); }).status());
    std::printf("%llu nodes, %zu batches; ",
                static_cast<unsigned long long>(session->applied_count()), batches.size());
  }
  std::printf("\n");
  return Status::Ok();
}

}  // namespace
}  // namespace mtdb

int main() {
  mtdb::Bytes file;
  std::byte block[1 << 14];
  while (const size_t n = std::fread(block, 1, sizeof(block), stdin)) {
    file.insert(file.end(), block, block + n);
  }
  const mtdb::Status status = mtdb::Run(file);
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.message().c_str());
  return status.ok() ? 0 : 1;
}
