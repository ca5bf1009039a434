// SPDX-License-Identifier: Apache-2.0
// What moving a cut costs: time, updates and bytes.
//
//   session_bench [--frames N] [--triangles T] [--large T] [--json FILE] [MESH]
//   session_bench [--frames N] [--json FILE] --store STORE [--only PATHS]
//
// sweep: the experiment of De Floriani, Magillo and Puppo (1998): a box of full resolution that
//   holds some 500 triangles moves over the mesh (a sculpture of T triangles when none is given)
//   along its longest axis, from border to border. Per frame, in milliseconds of processor time: a
//   mesh from scratch (Select and Emit), the session's update, encoding, decoding; updates; bytes.
// path: a box of full resolution with a margin at 10 error steps moves over a larger sculpture;
//   bytes per changed triangle, against Draco's for a mesh of just the new triangles of each frame.
// window: a client that is clipped to a box, which slides along the path of a larger sculpture, in
//   the smallest cut of full resolution in the box, and in one of the same accuracy everywhere;
//   bytes per entering triangle, against Draco's for a mesh of just these.
// progressive: all updates from the root to full resolution: bytes against the payloads of the same
//   nodes in the store, and the rates of encoding and decoding.
// camera: a viewer goes around the larger sculpture, towards it and away from it, 1 % of the
//   diagonal a frame; the threshold is in pixels or linear in the distance from the eye, and such
//   that a twentieth of the triangles is left. From scratch is Select and Emit to a sink that drops
//   the mesh. One thread, warm cache. Bytes per new triangle against Draco's.
// region: likewise a box that moves by 1 % of its side a frame, the object around it as coarse as
//   may be (box) or at an error of its own (focus), and a frustum that turns by 1 % of its angle.
// budget: likewise the camera at a hundredth of a pixel, and a box of full resolution that moves
//   through a surface that is as coarse as it has to be, with at most a twentieth of the triangles.
// rounds: the cut of an even error with a twentieth of the triangles, from the root: after each
//   round the time so far, bytes, triangles, and the distance of the last mesh from this one; Draco
//   shows nothing before its last byte.
//
// With --store only the last five, on the first object of the store; with --only one of them.
// --json writes all rows to a file.
//
// Checks after each frame that the client's mesh has as many triangles and vertices as the cut, and
// that the session applied as many nodes as Select; of a clipped client, that it has as many
// triangles as the cut has in the region. Exits with 1 when not, or when the progressive
// stream exceeds 1.4 times the payloads.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "bench/internal/draco_peer.h"
#include "bench/internal/hausdorff.h"
#include "bench/internal/workload.h"
#include "codecs/mesh_file/mesh_file.h"
#include "codecs/stream/update_stream.h"
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

nlohmann::json rows = nlohmann::json::array();

void AddRow(nlohmann::json row) { rows.push_back(std::move(row)); }

// Writes the rows; what the program returns.
int Finish(const std::string& json_file) {
  if (!json_file.empty()) {
    std::ofstream out(json_file);
    out << rows.dump(1) << '\n';
    Expect(out.good(), "the file of rows cannot be written");
  }
  return all_right ? 0 : 1;
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
  uint64_t inside = 0;
  for (size_t f = 1; f < path.size(); ++f) {
    Query query = BoxQuery(path[f], side);
    query.clip = true;
    inside += surface->Select(query).value().triangle_count();
    query.clip = false;
    const double begin = ProcessCpuSeconds();
    Cut cut = surface->Select(query).value();
    NullSink sink;
    const Status status = cut.Emit(sink);
    totals.scratch += ProcessCpuSeconds() - begin;
    MTDB_CHECK(status.ok(), status.message().c_str());
    totals.Add(connection.Move(query));
    triangles += cut.triangle_count();
    Expect(connection.session().applied_count() == cut.applied_count(), "nodes of the session");
  }
  const auto n = static_cast<double>(path.size() - 1);
  const auto per = [&](auto value) { return static_cast<double>(value) / n; };
  std::printf(
      "sweep: %llu triangles, box side %.4g of the diagonal, %.0f triangles in the cut, %.0f in "
      "the "
      "box\n",
      static_cast<unsigned long long>(surface->record().triangles),
      side / surface->record().diagonal(), per(triangles), per(inside));
  std::printf("  per frame: from scratch %.3f ms, update %.3f ms, encode %.3f ms, decode %.3f ms\n",
              1e3 * per(totals.scratch), 1e3 * per(totals.update), 1e3 * per(totals.encode),
              1e3 * per(totals.decode));
  std::printf("  per frame: %.1f insertions, %.1f removals, %.1f bytes\n", per(totals.insertions),
              per(totals.removals), per(totals.bytes));
  AddRow({{"experiment", "sweep"},
          {"object_triangles", surface->record().triangles},
          {"cut_triangles", per(triangles)},
          {"inside", per(inside)},
          {"scratch_ms", 1e3 * per(totals.scratch)},
          {"update_ms", 1e3 * per(totals.update)},
          {"encode_ms", 1e3 * per(totals.encode)},
          {"decode_ms", 1e3 * per(totals.decode)},
          {"insertions", per(totals.insertions)},
          {"removals", per(totals.removals)},
          {"bytes", per(totals.bytes)}});
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
  AddRow({{"experiment", "path"},
          {"object_triangles", record.triangles},
          {"update_ms", 1e3 * totals.update / n},
          {"encode_ms", 1e3 * totals.encode / n},
          {"decode_ms", 1e3 * totals.decode / n},
          {"insertions", static_cast<double>(totals.insertions) / n},
          {"removals", static_cast<double>(totals.removals) / n},
          {"bytes", static_cast<double>(totals.bytes) / n},
          {"new_triangles", static_cast<double>(changed) / n},
          {"bytes_per_new_triangle", ratio(totals.bytes)},
          {"draco_bytes_per_new_triangle", ratio(draco)}});
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

MeetsRegion MeetsBox(Vec3d centre, double side) {
  return [region = BoxQuery(centre, side).region](const Triangle3d& t) {
    return region->Within(t, 0);
  };
}

void Window(const std::shared_ptr<Surface>& surface, const TriangleMesh& mesh, int frames,
            bool uniform) {
  const ObjectRecord& record = surface->record();
  const std::vector<Vec3d> path = Path(mesh, record.bounds, frames);
  const double side = 0.1 * record.diagonal();
  const auto region_at = [&](Vec3d centre) { return MeetsBox(centre, side); };
  Query everywhere;
  everywhere.threshold = ConstantThreshold(0.0002 * record.diagonal());
  const auto query_at = [&](Vec3d centre) { return uniform ? everywhere : BoxQuery(centre, side); };
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
  AddRow({{"experiment", "window"},
          {"threshold", uniform ? "everywhere" : "in the box"},
          {"object_triangles", record.triangles},
          {"held_triangles", static_cast<double>(held) / n},
          {"new_triangles", static_cast<double>(entered) / n},
          {"update_ms", 1e3 * totals.update / n},
          {"encode_ms", 1e3 * totals.encode / n},
          {"decode_ms", 1e3 * totals.decode / n},
          {"bytes", static_cast<double>(totals.bytes) / n},
          {"bytes_per_new_triangle", ratio(totals.bytes)},
          {"draco_bytes_per_new_triangle", ratio(draco)}});
}

void Progressive(const std::shared_ptr<Surface>& surface) {
  const ClusterIndex& index = surface->index();
  uint64_t payloads = 0;
  for (uint32_t c = 0; c < index.cluster_count(); ++c) {
    payloads += index.location(c).length;
  }
  Connection connection(surface);
  const Connection::Frame frame = connection.Move({});
  const auto nodes = static_cast<double>(frame.insertions);
  const double ratio = static_cast<double>(frame.bytes) / static_cast<double>(payloads);
  std::printf("progressive: %.0f nodes; stream %.2f bits a node, payloads %.2f: %.3f times\n",
              nodes, 8.0 * static_cast<double>(frame.bytes) / nodes,
              8.0 * static_cast<double>(payloads) / nodes, ratio);
  const double memory = static_cast<double>(connection.encoder().memory_bytes()) /
                        static_cast<double>(connection.mesh().triangle_count());
  std::printf(
      "  update %.2f us, encode %.2f us, decode %.2f us a node; the sender keeps %.1f bytes a "
      "triangle\n",
      1e6 * frame.update / nodes, 1e6 * frame.encode / nodes, 1e6 * frame.decode / nodes, memory);
  AddRow({{"experiment", "progressive"},
          {"object_triangles", surface->record().triangles},
          {"nodes", frame.insertions},
          {"bits_per_node", 8.0 * static_cast<double>(frame.bytes) / nodes},
          {"payload_bits_per_node", 8.0 * static_cast<double>(payloads) / nodes},
          {"update_us_per_node", 1e6 * frame.update / nodes},
          {"encode_us_per_node", 1e6 * frame.encode / nodes},
          {"decode_us_per_node", 1e6 * frame.decode / nodes},
          {"sender_bytes_per_triangle", memory}});
  Expect(ratio <= 1.4, "the progressive stream is at most 1.4 times the payloads");
}

// The factor at which `query_with` leaves about so many triangles.
template <typename F>
double FactorFor(const Surface& surface, uint64_t triangles, F&& query_with) {
  double low = 1e-8;
  double high = 1;
  for (int i = 0; i < 16; ++i) {
    const double middle = std::sqrt(low * high);
    const Cut cut = surface.Select(query_with(middle)).value();
    (cut.triangle_count() > triangles ? low : high) = middle;
  }
  return high;
}

// A camera that looks at the object's centre from `angle_rad` and from a distance in diagonals.
Camera CameraAt(const ObjectRecord& record, double angle_rad, double distance) {
  const Vec3d centre = (record.bounds.min + record.bounds.max) * 0.5;
  const Vec3d away{std::cos(angle_rad), std::sin(angle_rad), 0.3};
  Camera camera;
  camera.eye = centre + away * (distance * record.diagonal() / Length(away));
  camera.direction = centre - camera.eye;
  return camera;
}

Query CameraQuery(const ObjectRecord& record, bool in_pixels, const std::string& path, int frame,
                  double factor) {
  constexpr double kStep = 0.01;
  constexpr double kDistance = 0.9;
  const double moved = kStep * frame;
  const Camera camera = path == "around"    ? CameraAt(record, moved / kDistance, kDistance)
                        : path == "towards" ? CameraAt(record, 0, kDistance - moved)
                                            : CameraAt(record, 0, kDistance + moved);
  Query query;
  query.threshold =
      in_pixels ? ScreenThreshold(camera, 1000 * factor) : LinearThreshold(camera.eye, 0, factor);
  return query;
}

// Every frame as a query of its own; seconds of all but the first.
struct FromScratch {
  double select = 0;
  double emit = 0;
  std::vector<uint64_t> nodes;  // of each frame
};
FromScratch SelectEach(const Surface& surface, int frames,
                       const std::function<Query(int)>& query_at) {
  FromScratch sum;
  for (int f = 0; f <= frames; ++f) {
    const double begin = ProcessCpuSeconds();
    Cut cut = surface.Select(query_at(f)).value();
    const double selected = ProcessCpuSeconds();
    NullSink sink;
    Expect(cut.Emit(sink).ok(), "emission");
    sum.nodes.push_back(cut.applied_count());
    if (f == 0) continue;
    sum.select += selected - begin;
    sum.emit += ProcessCpuSeconds() - selected;
  }
  return sum;
}

void Follow(const std::shared_ptr<Surface>& surface, const std::string& experiment,
            const std::string& path, const std::string& threshold,
            const std::function<Query(int)>& query_at, int frames) {
  const ObjectRecord& record = surface->record();
  const auto [select, emit, nodes] = SelectEach(*surface, frames, query_at);
  Connection connection(surface);
  Totals totals;
  uint64_t changed = 0;
  uint64_t draco = 0;
  for (int f = 0; f <= frames; ++f) {
    const uint64_t born = NewestBorn(connection.mesh());
    const Connection::Frame frame = connection.Move(query_at(f));
    Expect(connection.session().applied_count() == nodes[static_cast<size_t>(f)],
           "nodes of the session");
    if (f == 0) continue;
    totals.Add(frame);
    const TriangleMesh made = NewTriangles(connection.mesh(), born);
    changed += made.triangles.size();
    if (!made.triangles.empty()) draco += MeasureDraco(made, kDracoBits, 10).bytes;
  }
  const auto per = [&](auto value) { return static_cast<double>(value) / frames; };
  const auto of_changed = [&](uint64_t value) {
    return static_cast<double>(value) / static_cast<double>(std::max<uint64_t>(changed, 1));
  };
  const double ratio = totals.update / (select + emit);
  std::printf(
      "%s %s, %s: %u triangles; from scratch %.2f ms (emission %.2f), update %.2f ms: %.3f\n",
      experiment.c_str(), path.c_str(), threshold.c_str(), connection.mesh().triangle_count(),
      1e3 * per(select + emit), 1e3 * per(emit), 1e3 * per(totals.update), ratio);
  std::printf(
      "  per frame: %.0f insertions, %.0f removals, encode %.2f ms, decode %.2f ms, %.0f bytes\n",
      per(totals.insertions), per(totals.removals), 1e3 * per(totals.encode),
      1e3 * per(totals.decode), per(totals.bytes));
  std::printf("  bytes per new triangle: %.2f; Draco (%d bits, of the new triangles alone) %.2f\n",
              of_changed(totals.bytes), kDracoBits, of_changed(draco));
  AddRow({{"experiment", experiment},
          {"path", path},
          {"threshold", threshold},
          {"object_triangles", record.triangles},
          {"cut_triangles", connection.mesh().triangle_count()},
          {"scratch_ms", 1e3 * per(select + emit)},
          {"emit_ms", 1e3 * per(emit)},
          {"update_ms", 1e3 * per(totals.update)},
          {"update_of_scratch", ratio},
          {"encode_ms", 1e3 * per(totals.encode)},
          {"decode_ms", 1e3 * per(totals.decode)},
          {"insertions", per(totals.insertions)},
          {"removals", per(totals.removals)},
          {"bytes", per(totals.bytes)},
          {"new_triangles", per(changed)},
          {"bytes_per_new_triangle", of_changed(totals.bytes)},
          {"draco_bytes_per_new_triangle", of_changed(draco)}});
}

void FollowCamera(const std::shared_ptr<Surface>& surface, bool in_pixels, const char* path,
                  int frames) {
  const ObjectRecord& record = surface->record();
  const double factor = FactorFor(*surface, record.triangles / 20, [&](double value) {
    return CameraQuery(record, in_pixels, path, 0, value);
  });
  const auto query_at = [&](int frame) {
    return CameraQuery(record, in_pixels, path, frame, factor);
  };
  Follow(surface, "camera", path, in_pixels ? "pixels" : "linear", query_at, frames);
}

void FollowRegions(const std::shared_ptr<Surface>& surface, int frames) {
  constexpr double kSide = 0.4;  // of the diagonal
  constexpr double kStep = 0.01;
  const ObjectRecord& record = surface->record();
  const Vec3d centre = (record.bounds.min + record.bounds.max) * 0.5;
  const double side = kSide * record.diagonal();
  const auto box_at = [&](int frame) {
    const Vec3d moved{kStep * side * frame, 0, 0};
    return BoxQuery(centre + Vec3d{0, 0.25 * side, 0.25 * side} + moved, side);
  };
  const auto focus_at = [&](int frame) {
    Query query;
    query.threshold = RegionThreshold(box_at(frame).region, FullResolution(),
                                      ConstantThreshold(0.001 * record.diagonal()));
    return query;
  };
  const auto frustum_at = [&](int frame) {
    Camera camera = CameraAt(record, 0.5, 0.6);
    camera.direction = centre + Vec3d{0, 0.2 * side, 0.2 * side} - camera.eye;
    const double turn = kStep * 0.8 * frame;
    const Vec3d d = camera.direction;
    camera.direction = {d.x * std::cos(turn) - d.y * std::sin(turn),
                        d.x * std::sin(turn) + d.y * std::cos(turn), d.z};
    camera.far = record.diagonal();
    Query query;
    query.region = FrustumRegion(camera);
    return query;
  };
  Follow(surface, "region", "box", "full resolution", box_at, frames);
  Follow(surface, "region", "focus", "full resolution in it", focus_at, frames);
  Follow(surface, "region", "frustum", "full resolution", frustum_at, frames);
}

void FollowBudgets(const std::shared_ptr<Surface>& surface, int frames) {
  const ObjectRecord& record = surface->record();
  const uint64_t most = record.triangles / 20;
  for (const char* path : {"towards", "away", "around"}) {
    const auto query_at = [&](int frame) {
      Query query = CameraQuery(record, true, path, frame, 1e-5);
      query.max_triangles = most;
      return query;
    };
    Follow(surface, "budget", path, "pixels", query_at, frames);
  }
  const auto focus_at = [&](int frame) {
    constexpr double kSide = 0.1;  // of the diagonal
    const double side = kSide * record.diagonal();
    const Vec3d centre = (record.bounds.min + record.bounds.max) * 0.5;
    const Vec3d place = centre + Vec3d{0.2, 0.1, 0.2} * record.diagonal();
    Query query;
    query.threshold =
        RegionThreshold(BoxQuery(place + Vec3d{0.01 * side * frame, 0, 0}, side).region,
                        FullResolution(), ConstantThreshold(0));
    query.max_triangles = most;
    return query;
  };
  Follow(surface, "budget", "focus", "full resolution in it", focus_at, frames);
}

struct Round {
  double update = 0, total = 0;  // seconds so far
  uint64_t bytes = 0;            // so far
  TriangleMesh mesh;
};

// One update in rounds, each of which is sent and shown.
std::vector<Round> UpdateInRounds(const std::shared_ptr<Surface>& surface, const Query& query) {
  const ObjectRecord& record = surface->record();
  const auto session = Session::Open(surface).value();
  UpdateEncoder encoder({record.grid, record.attributes, kRemembered}, session->Base().value());
  UpdateDecoder decoder;
  Expect(decoder.Feed(encoder.start()).ok(), "the first message");
  std::vector<Round> rounds;
  Round sum;
  sum.bytes = encoder.start().size();
  double begin = ProcessCpuSeconds();
  const auto take = [&](std::span<const UpdateBatch> round) {
    const double updated = ProcessCpuSeconds();
    const Bytes bytes = encoder.Encode(round);
    MTDB_RETURN_IF_ERROR(decoder.Feed(bytes));
    sum.update += updated - begin;
    sum.total += ProcessCpuSeconds() - begin;
    sum.bytes += bytes.size();
    rounds.push_back(sum);
    rounds.back().mesh = NewTriangles(decoder.mesh(), 0);
    begin = ProcessCpuSeconds();
    return Status::Ok();
  };
  Expect(session->Update(query, BatchSink(take)).ok() && !rounds.empty(), "the rounds");
  return rounds;
}

void Rounds(const std::shared_ptr<Surface>& surface) {
  const ObjectRecord& record = surface->record();
  const auto query_with = [&](double factor) {
    Query query;
    query.threshold = ConstantThreshold(factor * record.diagonal());
    return query;
  };
  const Query query = query_with(FactorFor(*surface, record.triangles / 20, query_with));
  const double begin_once = ProcessCpuSeconds();
  std::vector<UpdateBatch> batches;
  const uint64_t triangles =
      Session::Open(surface).value()->Update(query, &batches).value().stats.triangles;
  const double once = ProcessCpuSeconds() - begin_once;

  const std::vector<Round> rounds = UpdateInRounds(surface, query);
  const TriangleMesh& last = rounds.back().mesh;
  Expect(last.triangles.size() == triangles, "triangles after the last round");
  const DracoResult draco = MeasureDraco(last, kDracoBits, 10);
  std::printf(
      "rounds: %llu triangles; all at once %.1f ms, in %zu rounds %.1f ms; Draco %llu bytes\n",
      static_cast<unsigned long long>(triangles), 1e3 * once, rounds.size(),
      1e3 * rounds.back().update, static_cast<unsigned long long>(draco.bytes));
  bool usable = false;
  for (const Round& r : rounds) {
    const double distance = OneSidedHausdorff(last, r.mesh, 0) / record.diagonal();
    const bool first = !usable && r.mesh.triangles.size() * 100 >= triangles;
    usable |= first;
    std::printf("  %7zu triangles after %.1f ms (update %.1f ms), %llu bytes: distance %.2g%s\n",
                r.mesh.triangles.size(), 1e3 * r.total, 1e3 * r.update,
                static_cast<unsigned long long>(r.bytes), distance,
                first ? "; the first usable mesh" : "");
    AddRow({{"experiment", "rounds"},
            {"object_triangles", record.triangles},
            {"cut_triangles", triangles},
            {"triangles", r.mesh.triangles.size()},
            {"update_ms", 1e3 * r.update},
            {"update_encode_decode_ms", 1e3 * r.total},
            {"bytes", r.bytes},
            {"distance_of_diagonal", distance},
            {"first_usable", first},
            {"at_once_ms", 1e3 * once},
            {"draco_bytes", draco.bytes},
            {"draco_decode_ms", 1e3 * draco.decode_seconds}});
  }
}

void FollowCameras(const std::shared_ptr<Surface>& surface, int frames) {
  for (const bool in_pixels : {true, false}) {
    for (const char* const path : {"around", "towards", "away"}) {
      FollowCamera(surface, in_pixels, path, frames);
    }
  }
}

// On the first object of a store.
void MeasureStore(const std::string& file, int frames, const std::string& only) {
  const auto database = Database::Open(file).value();
  const std::string name = database->List().value().at(0).name;
  const auto surface = Surface::Open(database->OpenObject(name).value(),
                                     {.cache_bytes = size_t{8} << 30, .threads = 1})
                           .value();
  const auto asked = [&](const char* what) { return only.empty() || only == what; };
  if (asked("progressive")) Progressive(surface);
  if (asked("camera")) FollowCameras(surface, frames);
  if (asked("region")) FollowRegions(surface, frames);
  if (asked("budget")) FollowBudgets(surface, frames);
  if (asked("rounds")) Rounds(surface);
}

int Main(int argc, char** argv) {
  CLI::App app("Dynamic updates: time, updates and bytes");
  int frames = 100;
  uint64_t triangles = 70000;
  uint64_t large = 1000000;
  std::string file;
  std::string store_file;
  std::string json_file;
  app.add_option("--frames", frames, "of the sweep and the path");
  app.add_option("--triangles", triangles, "of the sculpture without MESH");
  app.add_option("--large", large, "triangles of the larger sculpture; 0: none");
  app.add_option("MESH", file);
  app.add_option("--store", store_file, "measure its first object");
  std::string only;
  app.add_option("--only", only, "of a store: progressive, camera, region, budget or rounds")
      ->check(CLI::IsMember({"progressive", "camera", "region", "budget", "rounds"}));
  app.add_option("--json", json_file, "write the rows there");
  CLI11_PARSE(app, argc, argv);

  if (!store_file.empty()) {
    MeasureStore(store_file, std::min(frames, 20), only);
    return Finish(json_file);
  }
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
    FollowCameras(larger, std::min(frames, 20));
    FollowRegions(larger, std::min(frames, 20));
    FollowBudgets(larger, std::min(frames, 20));
    Rounds(larger);
  }
  return Finish(json_file);
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
