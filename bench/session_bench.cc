// What moving a cut costs: time, updates and bytes.
//
//   session_bench [--frames N] [--triangles T] [--large T] [MESH]
//
// sweep: the experiment of De Floriani, Magillo and Puppo (1998): a box of full resolution that
//   holds some 500 triangles moves over the mesh (a sculpture of T triangles when none is given)
//   along its longest axis, from border to border. Per frame, in milliseconds of processor time: a
//   cut from scratch (Surface::Select), the session's update, encoding, decoding; updates; bytes.
// path: a box of full resolution with a margin at 10 error steps moves over a larger sculpture;
//   bytes per changed triangle, against Draco's for a mesh of just the new triangles of each frame.
// window: a client that is clipped to a box, which slides along the path of a larger sculpture, in
//   the smallest cut of full resolution in the box, and in one of the same accuracy everywhere;
//   bytes per entering triangle, against Draco's for a mesh of just these.
// progressive: all updates from the root to full resolution: bytes against the payloads of the same
//   nodes in the store, and the rates of encoding and decoding.
//
// Checks after each frame that the client's mesh has as many triangles and vertices as the cut, and
// that the session applied as many nodes as Select; of a clipped client, that it has as many
// triangles as the cut has in the region. Exits with 1 when not, or when the progressive
// stream exceeds 1.4 times the payloads.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/internal/draco_peer.h"
#include "bench/internal/workload.h"
#include "codecs/mesh_file.h"
#include "codecs/update_stream.h"
#include "query/session.h"

namespace mtdb {
namespace {

constexpr uint32_t kRemembered = 65536;
constexpr int kDracoBits = 16;
bool all_right = true;

void Expect(bool right, const char* what) {
  if (right) return;
  std::printf("WRONG: %s\n", what);
  all_right = false;
}

// A session, its stream and its client.
class Connection {
 public:
  explicit Connection(const std::shared_ptr<Surface>& surface, const MeetsRegion& region = {})
      : session_(Session::Open(surface).value()),
        encoder_({surface->record().grid, surface->record().attributes, kRemembered},
                 session_->Base().value(), region) {
    const Status status = decoder_.Feed(encoder_.start());
    MTDB_CHECK(status.ok(), status.message().c_str());
  }
  struct Frame {
    double update = 0, encode = 0, decode = 0;  // seconds
    uint64_t insertions = 0, removals = 0, bytes = 0;
  };
  Frame Move(const Query& query, const MeetsRegion& region = {}) {
    Frame frame;
    std::vector<UpdateBatch> batches;
    const double begin = ProcessCpuSeconds();
    const SessionUpdate update = session_->Update(query, &batches).value();
    const double updated = ProcessCpuSeconds();
    const Bytes bytes = encoder_.Encode(batches, region);
    const double encoded = ProcessCpuSeconds();
    const Status status = decoder_.Feed(bytes);
    MTDB_CHECK(status.ok(), status.message().c_str());
    frame = {updated - begin,   encoded - updated, ProcessCpuSeconds() - encoded,
             update.insertions, update.removals,   bytes.size()};
    if (region) return frame;
    Expect(mesh().triangle_count() == update.stats.triangles, "triangles of the client");
    Expect(mesh().vertex_count() == update.stats.vertices, "vertices of the client");
    return frame;
  }
  const ClientMesh& mesh() const { return decoder_.mesh(); }
  const UpdateEncoder& encoder() const { return encoder_; }
  const Session& session() const { return *session_; }

 private:
  const std::unique_ptr<Session> session_;
  UpdateEncoder encoder_;
  UpdateDecoder decoder_;
};

Query BoxQuery(Vec3d centre, double side) {
  const Vec3d half{0.5 * side, 0.5 * side, 0.5 * side};
  Box3d box;
  box.Add(centre - half);
  box.Add(centre + half);
  Query query;
  query.region = BoxRegion(box);
  return query;
}

// Points of the mesh along the longest axis of its box, one a frame.
std::vector<Vec3d> Path(const TriangleMesh& mesh, const Box3d& bounds, int frames) {
  const Vec3d size = bounds.max - bounds.min;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  std::vector<Vec3d> path;
  for (int f = 0; f < frames; ++f) {
    Vec3d at = (bounds.min + bounds.max) * 0.5;
    at[axis] = bounds.min[axis] + size[axis] * (f + 0.5) / frames;
    at[(axis + 1) % 3] = bounds.max[(axis + 1) % 3];  // so that the path stays on one side
    Vec3d best = mesh.positions[0];
    for (const Vec3d& p : mesh.positions) {
      if (SquaredLength(p - at) < SquaredLength(best - at)) best = p;
    }
    path.push_back(best);
  }
  return path;
}

// The side of a box that holds so many triangles on average.
double SideFor(const Surface& surface, const std::vector<Vec3d>& path, uint64_t triangles) {
  double low = 0;
  double high = surface.record().diagonal();
  for (int i = 0; i < 12; ++i) {
    const double side = 0.5 * (low + high);
    uint64_t sum = 0;
    uint64_t count = 0;
    for (size_t p = 0; p < path.size(); p += std::max<size_t>(1, path.size() / 8), ++count) {
      Query query = BoxQuery(path[p], side);
      query.clip = true;
      sum += surface.Select(query).value().triangle_count();
    }
    (sum > triangles * count ? high : low) = side;
  }
  return low;
}

struct Totals {
  double scratch = 0, update = 0, encode = 0, decode = 0;
  uint64_t insertions = 0, removals = 0, bytes = 0;
  void Add(const Connection::Frame& f) {
    update += f.update;
    encode += f.encode;
    decode += f.decode;
    insertions += f.insertions;
    removals += f.removals;
    bytes += f.bytes;
  }
};

void Sweep(const std::shared_ptr<Surface>& surface, const TriangleMesh& mesh, int frames) {
  const std::vector<Vec3d> path = Path(mesh, surface->record().bounds, frames);
  const double side = SideFor(*surface, path, 500);
  Connection connection(surface);
  connection.Move(BoxQuery(path[0], side));
  Totals totals;
  uint64_t triangles = 0;
  for (size_t f = 1; f < path.size(); ++f) {
    const Query query = BoxQuery(path[f], side);
    const double begin = ProcessCpuSeconds();
    const Cut cut = surface->Select(query).value();
    totals.scratch += ProcessCpuSeconds() - begin;
    totals.Add(connection.Move(query));
    triangles += cut.triangle_count();
    Expect(connection.session().applied_count() == cut.applied_count(), "nodes of the session");
  }
  const auto n = static_cast<double>(path.size() - 1);
  const auto per = [&](auto value) { return static_cast<double>(value) / n; };
  std::printf("sweep: %llu triangles, box side %.4g of the diagonal, %.0f triangles in the cut\n",
              static_cast<unsigned long long>(surface->record().triangles),
              side / surface->record().diagonal(), per(triangles));
  std::printf("  per frame: from scratch %.3f ms, update %.3f ms, encode %.3f ms, decode %.3f ms\n",
              1e3 * per(totals.scratch), 1e3 * per(totals.update), 1e3 * per(totals.encode),
              1e3 * per(totals.decode));
  std::printf("  per frame: %.1f insertions, %.1f removals, %.1f bytes\n", per(totals.insertions),
              per(totals.removals), per(totals.bytes));
  std::printf("  listed %llu, recalled %llu\n",
              static_cast<unsigned long long>(connection.encoder().listed_updates()),
              static_cast<unsigned long long>(connection.encoder().recalled_vertices()));
}

// The triangles that were born after `born`.
TriangleMesh NewTriangles(const ClientMesh& mesh, uint64_t born) {
  TriangleMesh result;
  std::vector<VertexIndex> number(mesh.vertex_slots(), ~VertexIndex{0});
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    if (!mesh.has_triangle(slot) || mesh.triangle(slot).born <= born) continue;
    TriangleVertices& t = result.triangles.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t v = mesh.triangle(slot).corners[c];
      if (number[v] == ~VertexIndex{0}) {
        number[v] = result.positions.size();
        result.positions.push_back(mesh.options().grid.Position(mesh.position(v)));
      }
      t[c] = number[v];
    }
  }
  result.header.vertex_count = result.positions.size();
  result.header.triangle_count = result.triangles.size();
  return result;
}

uint64_t NewestBorn(const ClientMesh& mesh) {
  uint64_t born = 0;
  for (uint32_t slot = 0; slot < mesh.triangle_slots(); ++slot) {
    born = std::max(born, mesh.triangle(slot).born);
  }
  return born;
}

void FollowPath(const std::shared_ptr<Surface>& surface, const TriangleMesh& mesh, int frames) {
  const ObjectRecord& record = surface->record();
  const std::vector<Vec3d> path = Path(mesh, record.bounds, frames);
  Connection connection(surface);
  const auto query_at = [&](Vec3d centre) {
    Query query;
    const RegionPtr near = BoxQuery(centre, 0.1 * record.diagonal()).region;
    query.threshold =
        RegionThreshold(near, FullResolution(), ConstantThreshold(0.003 * record.diagonal()));
    return query;
  };
  const Connection::Frame first = connection.Move(query_at(path[0]));
  Totals totals;
  uint64_t changed = 0;
  uint64_t draco = 0;
  for (size_t f = 1; f < path.size(); ++f) {
    const uint64_t born = NewestBorn(connection.mesh());
    totals.Add(connection.Move(query_at(path[f])));
    const TriangleMesh made = NewTriangles(connection.mesh(), born);
    changed += made.triangles.size();
    if (!made.triangles.empty()) draco += MeasureDraco(made, kDracoBits, 10).bytes;
  }
  const auto ratio = [&](uint64_t value) {
    return static_cast<double>(value) / static_cast<double>(std::max<uint64_t>(changed, 1));
  };
  const auto n = static_cast<double>(path.size() - 1);
  std::printf("path: %llu triangles; first frame %llu bytes for %llu insertions\n",
              static_cast<unsigned long long>(record.triangles),
              static_cast<unsigned long long>(first.bytes),
              static_cast<unsigned long long>(first.insertions));
  std::printf("  per frame: %.0f new triangles, %.0f insertions, %.0f removals, %.0f bytes\n",
              static_cast<double>(changed) / n, static_cast<double>(totals.insertions) / n,
              static_cast<double>(totals.removals) / n, static_cast<double>(totals.bytes) / n);
  std::printf("  per frame: update %.2f ms, encode %.2f ms, decode %.2f ms\n",
              1e3 * totals.update / n, 1e3 * totals.encode / n, 1e3 * totals.decode / n);
  std::printf("  bytes per new triangle: %.2f; Draco (%d bits, of the new triangles alone) %.2f\n",
              ratio(totals.bytes), kDracoBits, ratio(draco));
}

// How many triangles of the query's cut meet the region.
uint32_t CountMeeting(const Surface& surface, const Query& query, const MeetsRegion& region) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  Cut cut = surface.Select(query).value();
  const Status status = cut.Emit(sink);
  MTDB_CHECK(status.ok(), status.message().c_str());
  return static_cast<uint32_t>(
      std::count_if(mesh.triangles.begin(), mesh.triangles.end(), [&](const TriangleVertices& t) {
        return region({mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]});
      }));
}

void Window(const std::shared_ptr<Surface>& surface, const TriangleMesh& mesh, int frames,
            bool uniform) {
  const ObjectRecord& record = surface->record();
  const std::vector<Vec3d> path = Path(mesh, record.bounds, frames);
  const double side = 0.1 * record.diagonal();
  const auto region_at = [&](Vec3d centre) -> MeetsRegion {
    return [region = BoxQuery(centre, side).region](const Triangle3d& t) {
      return region->Within(t, 0);
    };
  };
  const auto query_at = [&](Vec3d centre) {
    Query query;
    if (uniform) {
      query.threshold = ConstantThreshold(0.0002 * record.diagonal());
    } else {
      query = BoxQuery(centre, side);
    }
    return query;
  };
  Connection connection(surface, region_at(path[0]));
  const Connection::Frame first = connection.Move(query_at(path[0]), region_at(path[0]));
  const uint32_t first_triangles = connection.mesh().triangle_count();
  Totals totals;
  uint64_t entered = 0;
  uint64_t held = 0;
  uint64_t draco = 0;
  for (size_t f = 1; f < path.size(); ++f) {
    const uint64_t born = NewestBorn(connection.mesh());
    totals.Add(connection.Move(query_at(path[f]), region_at(path[f])));
    const TriangleMesh made = NewTriangles(connection.mesh(), born);
    entered += made.triangles.size();
    held += connection.mesh().triangle_count();
    Expect(connection.mesh().triangle_count() ==
               CountMeeting(*surface, query_at(path[f]), region_at(path[f])),
           "triangles of the clipped client");
    if (!made.triangles.empty()) draco += MeasureDraco(made, kDracoBits, 10).bytes;
  }
  const auto ratio = [&](uint64_t value) {
    return static_cast<double>(value) / static_cast<double>(std::max<uint64_t>(entered, 1));
  };
  const auto n = static_cast<double>(path.size() - 1);
  std::printf("window, %s: first frame %llu bytes for %u triangles\n",
              uniform ? "the same accuracy everywhere" : "full resolution in the box",
              static_cast<unsigned long long>(first.bytes), first_triangles);
  std::printf(
      "  per frame: %.0f triangles held, %.0f entered, %.0f bytes; encode %.2f ms, decode %.2f "
      "ms\n",
      static_cast<double>(held) / n, static_cast<double>(entered) / n,
      static_cast<double>(totals.bytes) / n, 1e3 * totals.encode / n, 1e3 * totals.decode / n);
  std::printf("  bytes per entering triangle: %.2f; Draco (%d bits, of these alone) %.2f\n",
              ratio(totals.bytes), kDracoBits, ratio(draco));
  std::printf("  vertices: sent %llu, recalled %llu\n",
              static_cast<unsigned long long>(connection.encoder().sent_vertices()),
              static_cast<unsigned long long>(connection.encoder().recalled_vertices()));
}

void Progressive(const std::shared_ptr<Surface>& surface) {
  const ClusterIndex& index = surface->index();
  uint64_t payloads = 0;
  for (uint32_t c = 0; c < index.cluster_count(); ++c) {
    payloads += index.location(ClusterId(c)).length;
  }
  Connection connection(surface);
  const Connection::Frame frame = connection.Move({});
  const auto nodes = static_cast<double>(frame.insertions);
  const double ratio = static_cast<double>(frame.bytes) / static_cast<double>(payloads);
  std::printf("progressive: %.0f nodes; stream %.2f bits a node, payloads %.2f: %.3f times\n",
              nodes, 8.0 * static_cast<double>(frame.bytes) / nodes,
              8.0 * static_cast<double>(payloads) / nodes, ratio);
  std::printf("  update %.2f us, encode %.2f us, decode %.2f us a node\n",
              1e6 * frame.update / nodes, 1e6 * frame.encode / nodes, 1e6 * frame.decode / nodes);
  Expect(ratio <= 1.4, "the progressive stream is at most 1.4 times the payloads");
}

int Main(int argc, char** argv) {
  CLI::App app("Dynamic updates: time, updates and bytes");
  int frames = 100;
  uint64_t triangles = 70000;
  uint64_t large = 1000000;
  std::string file;
  app.add_option("--frames", frames, "of the sweep and the path");
  app.add_option("--triangles", triangles, "of the sculpture without MESH");
  app.add_option("--large", large, "triangles of the larger sculpture; 0: none");
  app.add_option("MESH", file);
  CLI11_PARSE(app, argc, argv);

  TriangleMesh mesh;
  if (file.empty()) {
    mesh = Sculpture(triangles);
  } else {
    TriangleMeshSink sink(&mesh);
    MeshReadReport report;
    const Status status = ReadMeshFile(file, sink, &report);
    if (!status.ok()) {
      std::printf("%s\n", status.message().c_str());
      return 1;
    }
    mesh.header.attributes = {};
    mesh.rows.clear();
  }
  BenchStore store;
  store.Build("mesh", mesh, {});
  const auto surface = store.OpenSurface("mesh", {.threads = 1});
  Sweep(surface, mesh, frames);
  Progressive(surface);
  if (large > 0) {
    store.Build("large", Sculpture(large), {});
    const auto larger = store.OpenSurface("large", {.threads = 1});
    const TriangleMesh large_mesh = Sculpture(large);
    FollowPath(larger, large_mesh, std::min(frames, 40));
    Window(larger, large_mesh, frames, false);
    Window(larger, large_mesh, frames, true);
    Progressive(larger);
  }
  return all_right ? 0 : 1;
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
