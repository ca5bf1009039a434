// SPDX-License-Identifier: Apache-2.0
// How small the codec makes clusters, stream by stream, and how fast it decodes them.
//
//   codec_bench [--sculpture N]... [--terrain N]... [--seed S]... [--bits N] [--no-peers]
//               [--attributes [--normals BITS]] [--fit FILE] [--json FILE] [MESH]...
//
// For each object of stores (*.mtdb, such as terrains; as they are, and without peers), and each
// mesh (files; generated ones of N triangles for each seed), of its positions alone (with
// --attributes also of them, and the bits of each; a colour's stand at its red, a normal's on the
// octahedron at its nx), in a store of its own:
//   bits a vertex of each stream of its clusters, of the roots, of payloads and of the whole file;
//   for the decisions that models code: their entropy when each context had the best fixed
//   distribution of the whole mesh, and what they take;
//   decode: all clusters, each from its payload and its in-triangles to its explicit form
//   (DecodeCluster); load: reading, checking and gathering the in-triangles included (LoadUnit),
//   from a new handle. Both in full-resolution triangles of the mesh per second of processor time.
//   peers: Draco's size at levels 10 and 7 of the full-resolution mesh alone, with as many bits,
//   and its rate of decoding; likewise zstd's at levels 3 and 19 of the mesh as a binary PLY file.
// With --fit, the priors of the models are fitted to these meshes, each counting the same, and
// written to FILE (codecs/coding/cluster_priors.inc), which makes another format.
//
// Checks that every cluster encodes to its bytes again. Exits with 1 when one does not.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "bench/internal/draco_peer.h"
#include "bench/internal/workload.h"
#include "bench/internal/zstd_peer.h"
#include "codecs/cluster/internal/cluster_payload.h"
#include "codecs/mesh_file/mesh_file.h"
#include "query/cache/cluster_cache.h"
#include "tools/generate/generate.h"

namespace mtdb {

using namespace internal;

namespace {

// What the models of a cluster saw: counts, by table of priors and context, and bits spent.
class ModelCounts final : public ModelObserver {
 public:
  struct Table {
    std::string name;
    bool is_bits = false;
    std::vector<std::array<double, 16>> contexts;  // of bits: [0] zeros, [1] ones
    double spent_bits = 0;
  };

  // Watches these models from now on.
  void Watch(ClusterModels& models) {
    ranges_.clear();
    size_t next = 0;
    models.ForEachTable(
        [&]<typename Model, size_t kSize>(const char* name, std::span<Model, kSize> table) {
          if (next == tables_.size())
            tables_.push_back({name, std::is_same_v<Model, AdaptiveBit>, {}});
          tables_[next].contexts.resize(table.size());
          const auto begin = reinterpret_cast<uintptr_t>(table.data());
          ranges_.push_back({begin, begin + table.size_bytes(), sizeof(Model), next++});
        });
  }
  void Saw(const AdaptiveBit& model, bool bit) override {
    const double one = double{1} / AdaptiveBit::kOne * model.probability;
    Count(&model, bit ? 1 : 0, bit ? one : 1 - one);
  }
  void Saw(const AdaptiveSymbol& model, uint32_t symbol) override {
    Count(&model, symbol, double{1} / kProbabilityOne * (model.end(symbol) - model.begin(symbol)));
  }
  void SawAttribute(size_t attribute, double bits) override { attribute_bits_[attribute] += bits; }
  // By the first attribute of the channel.
  const std::map<size_t, double>& attribute_bits() const { return attribute_bits_; }
  // Adds the counts of another mesh, times `weight`.
  void Add(const ModelCounts& other, double weight) {
    if (tables_.empty()) {
      tables_ = other.tables_;
      for (Table& t : tables_) std::fill(t.contexts.begin(), t.contexts.end(), Row{});
    }
    for (size_t t = 0; t < tables_.size(); ++t) {
      for (size_t c = 0; c < tables_[t].contexts.size(); ++c) {
        for (size_t s = 0; s < 16; ++s) {
          tables_[t].contexts[c][s] += weight * other.tables_[t].contexts[c][s];
        }
      }
    }
  }
  const std::vector<Table>& tables() const { return tables_; }

  // In bits, with the best fixed distribution in each context.
  static double Entropy(const Table& table) {
    double bits = 0;
    for (const Row& row : table.contexts) {
      double sum = 0;
      for (const double n : row) sum += n;
      for (const double n : row) bits += n > 0 ? n * std::log2(sum / n) : 0;
    }
    return bits;
  }

 private:
  using Row = std::array<double, 16>;
  struct Range {
    uintptr_t begin, end;
    size_t model_bytes;
    size_t table;
  };
  void Count(const void* model, size_t value, double probability) {
    const auto at = reinterpret_cast<uintptr_t>(model);
    for (const Range& r : ranges_) {
      if (at < r.begin || at >= r.end) continue;
      tables_[r.table].contexts[(at - r.begin) / r.model_bytes][value] += 1;
      tables_[r.table].spent_bits -= std::log2(probability);
    }
  }
  std::vector<Table> tables_;
  std::vector<Range> ranges_;
  std::map<size_t, double> attribute_bits_;
};

// Writes what the counts make of the priors (codecs/FORMAT.md, "Priors").
void WritePriors(const ModelCounts& counts, std::ostream& out) {
  out << "// Priors of the models in cluster_model.h: what they are before the first symbol of a "
         "cluster.\n// Made by codec_bench --fit; see codecs/FORMAT.md.\n// clang-format off\n";
  for (const ModelCounts::Table& t : counts.tables()) {
    const size_t n = t.contexts.size();
    out << "constexpr " << (t.is_bits ? "uint16_t " : "int16_t ") << t.name << "[" << n << "]"
        << (t.is_bits ? "" : "[16]") << " = {";
    for (size_t c = 0; c < n; ++c) {
      const std::array<double, 16>& row = t.contexts[c];
      if (t.is_bits) {
        const double p = (row[1] + 0.4) / (row[0] + row[1] + 0.8);
        const double scaled = std::clamp(std::round(65536 * p), 600.0, 65536.0 - 600);
        out << (c % 12 == 0 ? "\n    " : " ") << static_cast<int>(scaled) << ",";
        continue;
      }
      double sum = 0;
      for (const double k : row) sum += k;
      const double add = sum < 50 ? 2.3 : 0.3;
      // The least interval is 16 wide; the rest is shared out.
      constexpr double kLeast = 16;
      constexpr double kShared = kProbabilityOne - 16 * kLeast;
      out << "\n    {";
      double below = 0;
      for (size_t s = 0; s < 16; ++s) {
        const double begin = kLeast * static_cast<double>(s) + kShared * below;
        out << (s == 0 ? "" : ", ") << static_cast<int>(begin);
        below += (row[s] + add) / (sum + 16 * add);
      }
      out << "},";
    }
    out << "\n};\n";
  }
  out << "// clang-format on\n";
}

struct Arguments {
  std::vector<std::string> meshes;
  std::vector<uint64_t> sculptures, terrains, seeds{1};
  int bits = 16;
  uint32_t tile_triangles = BuildOptions{}.tile_triangles;
  bool attributes = false;
  std::optional<int> normal_bits;
  bool no_peers = false;
  std::string json;  // a file
  std::string fit_path;
};

class Bench {
 public:
  explicit Bench(const Arguments& arguments) : arguments_(arguments) {}

  // False when the mesh cannot be read, or a cluster does not encode to its bytes.
  bool RunFile(const std::string& path) {
    if (path.ends_with(".mtdb")) return RunStore(path);
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    if (const Status status = ReadMeshFile(path, sink, nullptr); !status.ok()) {
      std::fprintf(stderr, "%s\n", status.message().c_str());
      return false;
    }
    if (!arguments_.attributes) {
      mesh.header.attributes = {};
      mesh.rows = {};
    }
    return Run(path.substr(path.rfind('/') + 1), mesh);
  }
  bool RunGenerated(bool sculpture, uint64_t triangles, uint64_t seed) {
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    const GenerateOptions options{triangles, seed};
    const Status status =
        sculpture ? GenerateSculpture(options, sink) : GenerateTerrain(options, sink);
    MTDB_CHECK(status.ok(), status.message().c_str());
    return Run((sculpture ? "sculpture " : "terrain ") + std::to_string(triangles) + " seed " +
                   std::to_string(seed),
               mesh);
  }

  const Json& rows() const { return rows_; }
  const ModelCounts& counts() const { return all_counts_; }

 private:
  bool RunStore(const std::string& path) {
    const Result<std::shared_ptr<Database>> database = Database::Open(path, {});
    if (!database.ok()) {
      std::fprintf(stderr, "%s\n", database.status().message().c_str());
      return false;
    }
    bool good = true;
    const std::vector<ObjectRecord> records = (*database)->List().value();
    for (const ObjectRecord& record : records) {
      const auto open = [&] {
        return Surface::Open((*database)->OpenObject(record.name).value(), {}).value();
      };
      Json row;
      good &= Measure(record.name, record, path, open, &row);
      AddRow(std::move(row));
    }
    return good;
  }

  bool Run(const std::string& name, const TriangleMesh& mesh) {
    BenchStore store;
    BuildOptions options;
    options.bits = arguments_.bits;
    options.tile_triangles = arguments_.tile_triangles;
    if (arguments_.attributes && HasNormals(mesh)) options.normal_bits = arguments_.normal_bits;
    const ObjectRecord record = store.Build("mesh", mesh, options);
    Json row;
    const bool good = Measure(
        name, record, store.path(), [&] { return store.OpenSurface("mesh"); }, &row);
    if (!arguments_.no_peers) {
      const auto file_bytes = static_cast<double>(std::filesystem::file_size(store.path()));
      AddPeers(mesh, record, file_bytes, &row);
    }
    AddRow(std::move(row));
    return good;
  }

  void AddRow(Json row) {
    if (arguments_.json.empty()) std::cout << row.dump(2) << std::endl;
    rows_.push_back(std::move(row));
  }

  // `open`: the object, with an empty cache.
  template <typename Open>
  bool Measure(const std::string& name, const ObjectRecord& record, const std::string& store_path,
               Open&& open, Json* row_of_it) {
    const auto vertices = static_cast<double>(record.vertices);
    const auto triangles = static_cast<double>(record.triangles);
    const auto per_vertex = [&](double bytes) { return 8 * bytes / vertices; };

    const double load_seconds = TimeLoading(*open());
    ModelCounts counts;
    std::map<std::string, double> streams;
    double decode_seconds = 0;
    const bool good = Walk(*open(), name, counts, streams, decode_seconds);
    all_counts_.Add(counts, 1e5 / vertices);

    Json& row = *row_of_it;
    row = {{"mesh", name},
           {"vertices", record.vertices},
           {"triangles", record.triangles},
           {"clusters", record.clusters}};
    Json& stream_bits = row["stream_bits_per_vertex"];
    double cluster_bytes = 0;
    for (const auto& [stream, bytes] : streams) {
      stream_bits[stream] = per_vertex(bytes);
      cluster_bytes += bytes;
    }
    stream_bits["roots"] = per_vertex(static_cast<double>(record.payload_bytes) - cluster_bytes);
    for (const auto& [attribute, bits] : counts.attribute_bits()) {
      row["attribute_bits_per_vertex"][record.attributes.attributes[attribute].name] =
          bits / vertices;
    }
    Json& models = row["models"];
    for (const ModelCounts::Table& t : counts.tables()) {
      models[t.name] = {{"entropy_bits_per_vertex", ModelCounts::Entropy(t) / vertices},
                        {"spent_bits_per_vertex", t.spent_bits / vertices}};
    }
    const auto file_bytes = static_cast<double>(std::filesystem::file_size(store_path));
    row["payload_bits_per_vertex"] = per_vertex(static_cast<double>(record.payload_bytes));
    row["file_bits_per_vertex"] = per_vertex(file_bytes);
    row["payload_of_file"] = static_cast<double>(record.payload_bytes) / file_bytes;
    row["decode_mtriangles_per_core_second"] = 1e-6 * triangles / decode_seconds;
    row["load_mtriangles_per_core_second"] = 1e-6 * triangles / load_seconds;
    row["decode_ns_per_node"] = 1e9 * decode_seconds / static_cast<double>(record.nodes);
    return good;
  }

  void AddPeers(const TriangleMesh& mesh, const ObjectRecord& record, double file_bytes,
                Json* row) const {
    const auto vertices = static_cast<double>(record.vertices);
    const auto triangles = static_cast<double>(record.triangles);
    const auto per_vertex = [&](double bytes) { return 8 * bytes / vertices; };
    for (const int level : {10, 7}) {
      const DracoResult draco = MeasureDraco(mesh, arguments_.bits, level);
      const auto bytes = static_cast<double>(draco.bytes);
      (*row)["draco_level_" + std::to_string(level)] = {
          {"bits_per_vertex", per_vertex(bytes)},
          {"payload_to_it", static_cast<double>(record.payload_bytes) / bytes},
          {"file_to_it", file_bytes / bytes},
          {"decode_mtriangles_per_core_second", 1e-6 * triangles / draco.decode_seconds}};
    }
    const ZstdPeer zstd = MeasureZstd(mesh, {3, 19});
    (*row)["ply_bits_per_vertex"] = per_vertex(static_cast<double>(zstd.file_bytes));
    for (const ZstdResult& result : zstd.results) {
      (*row)["zstd_level_" + std::to_string(result.level)] = {
          {"bits_per_vertex", per_vertex(static_cast<double>(result.bytes))},
          {"file_to_it", file_bytes / static_cast<double>(result.bytes)},
          {"encode_mtriangles_per_core_second", 1e-6 * triangles / result.encode_seconds},
          {"decode_mtriangles_per_core_second", 1e-6 * triangles / result.decode_seconds}};
    }
  }

  static bool HasNormals(const TriangleMesh& mesh) {
    return std::ranges::any_of(mesh.header.attributes.attributes,
                               [](const VertexAttribute& a) { return a.name == "nx"; });
  }

  // Processor time to load every unit, coarsest first, so that parents are there.
  static double TimeLoading(const Surface& surface) {
    LoadStats stats;
    const double begin = ProcessCpuSeconds();
    for (UnitId unit = surface.index().unit_count(); unit-- > 0;) {
      surface.cache().Get(unit, &stats).value();
    }
    return ProcessCpuSeconds() - begin;
  }

  // Decodes and encodes every cluster; false when one does not encode to its bytes.
  static bool Walk(const Surface& surface, const std::string& name, ModelCounts& counts,
                   std::map<std::string, double>& streams, double& decode_seconds) {
    const ClusterIndex& index = surface.index();
    const AttributeLayout& attributes = surface.record().attributes;
    LoadStats stats;
    bool good = true;
    for (UnitId unit = index.unit_count(); unit-- > 0;) {
      const LoadedUnitPtr loaded = surface.cache().Get(unit, &stats).value();
      if (loaded->nodes() == 0) continue;
      Bytes payload;
      const UnitId id(unit);
      const Status status = ReadUnits(*surface.source(), {&id, 1}, [&](UnitId, Bytes bytes) {
        payload = std::move(bytes);
        return Status::Ok();
      });
      MTDB_CHECK(status.ok(), status.message().c_str());
      double listed = 0;
      for (const StreamSize& s : ClusterStreamSizes(payload)) {
        streams[s.name] += s.coded_bytes;
        listed += s.coded_bytes;
      }
      streams["directory"] += static_cast<double>(payload.size()) - listed;

      const InPatch in = loaded->cluster.in_patch(attributes.row_bytes());
      Cluster cluster;
      constexpr int kTimes = 3;  // the best one counts
      double best = 0;
      for (int i = 0; i < kTimes; ++i) {
        InPatch copy = in;
        const double begin = ProcessCpuSeconds();
        Result<Cluster> decoded =
            DecodeCluster(payload, std::move(copy), attributes, loaded->nodes(), name);
        const double seconds = ProcessCpuSeconds() - begin;
        MTDB_CHECK(decoded.ok(), "it was decoded before");
        cluster = *std::move(decoded);
        best = i == 0 ? seconds : std::min(best, seconds);
      }
      decode_seconds += best;

      ClusterModels models;
      counts.Watch(models);
      const bool terrain = surface.record().grid.mode == PositionMode::kRaster;
      const EncodedCluster encoded =
          EncodeCluster(UpdatesOf(cluster, terrain), attributes, models, &counts);
      if (encoded.payload == payload || encoded.explicit_arcs) continue;
      std::fprintf(stderr, "%s: cluster %u encodes to other bytes\n", name.c_str(), unit);
      good = false;
    }
    return good;
  }

  const Arguments& arguments_;
  Json rows_ = Json::array();
  ModelCounts all_counts_;
};

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Measures the codec of clusters, and fits its priors.");
  app.add_option("mesh", arguments.meshes, "Mesh files");
  app.add_option("--sculpture", arguments.sculptures, "Generated sculptures of so many triangles");
  app.add_option("--terrain", arguments.terrains, "Generated terrains of so many triangles");
  app.add_option("--seed", arguments.seeds, "Of the generated meshes");
  app.add_option("--bits", arguments.bits, "Of the grid");
  app.add_option("--tile", arguments.tile_triangles, "Triangles of a tile");
  app.add_flag("--attributes", arguments.attributes, "Keep the attributes of mesh files");
  app.add_option("--normals", arguments.normal_bits, "Bits of normals on the octahedron");
  app.add_flag("--no-peers", arguments.no_peers, "Without Draco and zstd");
  app.add_option("--json", arguments.json, "Write the rows to a file, not to standard output");
  app.add_option("--fit", arguments.fit_path, "Write the priors that fit these meshes");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  Bench bench(arguments);
  bool good = true;
  for (const std::string& path : arguments.meshes) good &= bench.RunFile(path);
  for (const uint64_t seed : arguments.seeds) {
    for (const uint64_t n : arguments.sculptures) good &= bench.RunGenerated(true, n, seed);
    for (const uint64_t n : arguments.terrains) good &= bench.RunGenerated(false, n, seed);
  }
  if (!arguments.json.empty()) good &= WriteRows(arguments.json, bench.rows());
  if (!arguments.fit_path.empty()) {
    std::ofstream out(arguments.fit_path);
    WritePriors(bench.counts(), out);
    good &= out.good();
  }
  return good ? 0 : 1;
}

}  // namespace

}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
