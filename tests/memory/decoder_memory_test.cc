// SPDX-License-Identifier: Apache-2.0
// What decoders take from the heap, whatever their bytes: a constant, and a factor of the bytes
// that they are given or that the client holds. Good inputs, mutated ones, and ones that are made
// to cost much.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <random>
#include <string>
#include <sys/mman.h>
#include <unistd.h>
#include <vector>

#include "codecs/cluster/internal/streams.h"
#include "codecs/cluster/root_codec.h"
#include "codecs/mesh_file/readers/readers.h"
#include "codecs/stream/update_stream.h"
#include "store/base/hash.h"
#include "store/object_record.h"
#include "store/pages/catalog_entry.h"
#include "store/records/index_codec.h"
#include "tests/codecs/update_fixture.h"
#include "tests/memory/allocation_peak.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr size_t kKilobyte = 1024;

// The promise of a decoder: it takes at most constant + factor * bytes.
struct Bound {
  const char* decoder;
  size_t constant;
  size_t factor;
};
// The models of kMaxAttributes.
constexpr Bound kStart{"start of an update stream", 12 * 1024 * kKilobyte, 128};
constexpr Bound kStream{"update stream", 256 * kKilobyte, 512};
constexpr Bound kCluster{"cluster payload", 512 * kKilobyte, 2 * kKilobyte};
constexpr Bound kRoot{"root payload", 64 * kKilobyte, 4 * kKilobyte};
constexpr Bound kRecord{"object record", 16 * kKilobyte, 64};
constexpr Bound kEntry{"catalog entry", 16 * kKilobyte, 16};
constexpr Bound kIndex{"index rows", 64 * kKilobyte, 32};
constexpr Bound kMeshFile{"mesh file", 4 * 1024 * kKilobyte, 64};
// A corner of a polygon, of two bytes: its place, its neighbours and the tree that it is in.
constexpr Bound kPolygonFile{"mesh file with polygons", 4 * 1024 * kKilobyte, 192};
// A value of JSON, and what its list grows by.
constexpr Bound kGltfFile{"glTF file", 4 * 1024 * kKilobyte, 192};
// DracoMesh::kMostPerByte triangles and vertices of a byte.
constexpr Bound kDracoFile{"Draco file", 4 * 1024 * kKilobyte, 64 * kKilobyte};

using Decode = std::function<void(ByteSpan)>;

// The largest share of its bound that any input took.
class Meter {
 public:
  Meter(const Bound& bound, Decode decode) : bound_(bound), decode_(std::move(decode)) {}
  ~Meter() {
    if (std::getenv("MTDB_PRINT_MEMORY") == nullptr) return;
    std::printf("%-28s %6zu inputs; %9zu bytes taken for %8zu, %5.1f%% of the bound\n",
                bound_.decoder, inputs_, worst_peak_, worst_bytes_, 100 * worst_);
  }
  // `held`: bytes that the client has beside the input.
  void Try(ByteSpan input, size_t held = 0) {
    const AllocationPeak peak;
    decode_(input);
    const size_t most = bound_.constant + bound_.factor * (input.size() + held);
    const size_t taken = peak.bytes();
    ++inputs_;
    if (const double share = static_cast<double>(taken) / static_cast<double>(most);
        share > worst_) {
      worst_ = share;
      worst_bytes_ = input.size();
      worst_peak_ = taken;
    }
    if (taken > most) {
      FAIL(bound_.decoder << ": " << taken << " bytes taken for an input of " << input.size()
                          << ", at most " << most << " are promised");
    }
  }
  // The input, its prefixes, and changes of it; `changes` of each kind.
  void TryAll(const Bytes& input, int changes, size_t held = 0) {
    Try(input, held);
    for (int i = 0; i < changes; ++i) {
      Try(ByteSpan(input).first(random_() % (input.size() + 1)), held);
      Bytes bad = input;
      for (uint32_t n = 1 + random_() % 4; n > 0 && !bad.empty(); --n) {
        bad[random_() % bad.size()] = static_cast<std::byte>(random_());
      }
      Try(bad, held);
      // A number that is large: a varint of nine bytes in place of one.
      if (bad.empty()) continue;
      const auto at = static_cast<std::ptrdiff_t>(random_() % bad.size());
      const size_t bytes = 1 + random_() % 9;
      Bytes large(bytes, static_cast<std::byte>(0xff));
      large.back() = static_cast<std::byte>(random_() & 0x7f);
      bad = input;
      bad.erase(bad.begin() + at);
      bad.insert(bad.begin() + at, large.begin(), large.end());
      Try(bad, held);
    }
  }

 private:
  const Bound bound_;
  const Decode decode_;
  std::mt19937 random_{3};
  size_t inputs_ = 0;
  double worst_ = 0;
  size_t worst_bytes_ = 0;
  size_t worst_peak_ = 0;
};

AttributeLayout Many(size_t attributes, ScalarType type = ScalarType::kInt8) {
  AttributeLayout layout;
  for (size_t i = 0; i < attributes; ++i) layout.attributes.push_back({std::to_string(i), type});
  return layout;
}

Bytes Framed(ByteSpan body) {
  ByteWriter w;
  for (const char c : {'M', 'T', 'U', 'S'}) w.Put(c);
  w.Put(uint8_t{3});
  w.PutBytes(UpdateRecord(body));
  return w.Take();
}

std::vector<Bytes> Bodies(size_t bytes) {
  std::mt19937 random(5);
  Bytes noise(bytes);
  for (std::byte& b : noise) b = static_cast<std::byte>(random());
  Bytes some(bytes);
  for (size_t i = 0; i < bytes; i += 16) some[i] = static_cast<std::byte>(random());
  return {Bytes(bytes), Bytes(bytes, static_cast<std::byte>(0xff)), noise, some};
}

// A sheet on the grid without noise: all is predicted. `row`: of constant attributes.
struct FlatSheet {
  ClusterFixture fixture = MakeCluster({.surface = Surface::kSheet,
                                        .side = 40,
                                        .numbers = Numbers::kCoincident,
                                        .children = 0,
                                        .keep = 0.02});
  explicit FlatSheet(size_t attributes) {
    fixture.attributes = Many(attributes, ScalarType::kFloat64);
    fixture.updates.rows.assign(fixture.updates.positions.size() * fixture.attributes.row_bytes(),
                                std::byte{0});
  }
};

}  // namespace

TEST_CASE("the start of an update stream takes memory by its bytes", "[memory]") {
  Meter meter(kStart, [](ByteSpan bytes) {
    UpdateDecoder decoder;
    static_cast<void>(decoder.Feed(bytes));
  });
  for (const AttributeLayout& layout :
       {AttributeLayout{}, Many(kMaxAttributes), Many(kMaxAttributes, ScalarType::kFloat64),
        Many(100'000)}) {
    for (const uint64_t count : {uint64_t{0}, uint64_t{1}, uint64_t{1} << 25, ~uint64_t{0}}) {
      ByteWriter body;
      body.Put<uint8_t>(0);
      for (int i = 0; i < 7; ++i) body.Put<double>(1);
      body.PutVarint(layout.attributes.size());
      for (const VertexAttribute& a : layout.attributes) {
        body.PutString(a.name);
        body.Put(static_cast<uint8_t>(a.type));
      }
      body.PutVarint(count);  // remembered
      body.PutVarint(count);
      body.PutVarint(count);
      const Bytes good = body.bytes();
      meter.Try(Framed(good));
      for (const Bytes& more : Bodies(20'000)) {
        Bytes longer = good;
        longer.insert(longer.end(), more.begin(), more.end());
        meter.Try(Framed(longer));
      }
    }
  }
  // Lengths that are only said.
  for (const uint64_t length : {uint64_t{1} << 28, (uint64_t{1} << 28) + 1, ~uint64_t{0}}) {
    ByteWriter w;
    for (const char c : {'M', 'T', 'U', 'S'}) w.Put(c);
    w.Put(uint8_t{3});
    w.PutVarint(length);
    w.Put(uint32_t{7});
    meter.Try(w.bytes());
  }
}

TEST_CASE("records of an update stream take memory by their bytes", "[memory]") {
  for (const bool rounded : {false, true}) {
    for (const bool sheet : {false, true}) {
      const UpdateFixture f({.surface = sheet ? Surface::kSheet : Surface::kTorus,
                             .side = 16,
                             .attributes = !rounded,
                             .rounded_attributes = rounded});
      UpdateEncoder encoder(f.options(50), f.base());
      const Bytes start = encoder.start();
      Meter meter(kStream, [&](ByteSpan record) {
        UpdateDecoder decoder;
        REQUIRE(decoder.Feed(start).ok());
        // As often as it is taken.
        const Bytes framed = UpdateRecord(record);
        static_cast<void>(decoder.Feed(framed));
      });
      const std::vector<bool> none(f.cluster().nodes());
      const std::vector<bool> all(f.cluster().nodes(), true);
      const MeetsRegion half = [](const Triangle3d& t) { return t[0].x < 2000; };
      std::vector<Bytes> bodies;
      for (const Bytes& stream : {encoder.Encode(f.Batches(none, all)), encoder.Encode({}, half),
                                  encoder.Encode(f.Batches(all, none), half), encoder.Encode({})}) {
        ByteReader reader(stream);
        while (reader.remaining() > 0) {
          const uint64_t length = reader.GetVarint();
          reader.Get<uint32_t>();
          const ByteSpan body = reader.GetBytes(length);
          bodies.emplace_back(body.begin(), body.end());
        }
      }
      for (const Bytes& body : bodies) {
        if (!body.empty()) meter.TryAll(body, 60, start.size());
      }
      for (const size_t bytes : {4, 64, 1000, 30'000}) {
        for (const Bytes& body : Bodies(bytes)) meter.Try(body, start.size());
      }
    }
  }
}

TEST_CASE("a stream of what costs nothing to say takes memory by its bytes", "[memory]") {
  for (const size_t attributes : {size_t{0}, size_t{3}, size_t{300}, kMaxAttributes}) {
    const FlatSheet sheet(attributes);
    const EncodedCluster encoded = EncodeCluster(sheet.fixture.updates, sheet.fixture.attributes);
    const InPatch in = MakeIn(sheet.fixture, encoded);
    const auto nodes = static_cast<uint32_t>(sheet.fixture.updates.nodes.size());
    const size_t held = in.rows.size() + 40 * in.triangles.size();
    Meter cluster_meter(kCluster, [&](ByteSpan payload) {
      static_cast<void>(DecodeCluster(payload, in, sheet.fixture.attributes, nodes, "test"));
    });
    REQUIRE(DecodeCluster(encoded.payload, in, sheet.fixture.attributes, nodes, "test").ok());
    cluster_meter.Try(encoded.payload, held + 2 * attributes);

    const UpdateFixture f(sheet.fixture);
    UpdateEncoder encoder(f.options(0), f.base());
    Bytes stream = encoder.start();
    const std::vector<bool> none(f.cluster().nodes());
    const std::vector<bool> all(f.cluster().nodes(), true);
    const Bytes records = encoder.Encode(f.Batches(none, all));
    stream.insert(stream.end(), records.begin(), records.end());
    Meter meter(kStream, [&](ByteSpan bytes) {
      UpdateDecoder decoder;
      REQUIRE(decoder.Feed(bytes).ok());
      REQUIRE(decoder.mesh().vertex_count() == encoder.mesh().vertex_count());
    });
    // Attributes of two bytes each have models of some 3 KB.
    meter.Try(stream, 6 * attributes);
  }
  // Triangles that lie upon each other, each by itself, with vertices of its own.
  BaseMesh base;
  for (uint32_t t = 0; t < 30'000; ++t) {
    base.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
    base.triangle_keys.push_back(t);
    for (uint32_t c = 0; c < 3; ++c) {
      base.vertices.push_back(3 * t + c);
      base.positions.push_back({static_cast<int32_t>(c), 0, 0});
    }
  }
  const auto everything = [](const Triangle3d&) { return true; };
  const UpdateEncoder encoder({{}, {}, 0}, base, everything);
  Meter meter(kStream, [&](ByteSpan bytes) {
    UpdateDecoder decoder;
    REQUIRE(decoder.Feed(bytes).ok());
    REQUIRE(decoder.mesh().triangle_count() == base.triangles.size());
  });
  meter.Try(encoder.start());
}

TEST_CASE("payloads take memory by their bytes", "[memory]") {
  for (const ClusterOptions& options :
       {ClusterOptions{.side = 24}, ClusterOptions{.side = 16, .attributes = true},
        ClusterOptions{.surface = Surface::kSheet, .side = 16, .rounded_attributes = true}}) {
    const ClusterFixture fixture = MakeCluster(options);
    const EncodedCluster encoded = EncodeCluster(fixture.updates, fixture.attributes);
    const InPatch in = MakeIn(fixture, encoded);
    const size_t held = in.rows.size() + 40 * in.triangles.size();
    Meter meter(kCluster, [&](ByteSpan payload) {
      static_cast<void>(DecodeCluster(payload, in, fixture.attributes, ~0u, "test"));
    });
    meter.TryAll(encoded.payload, 300, held);
  }
}

TEST_CASE("root payloads take memory by their bytes", "[memory]") {
  const AttributeLayout layout = Many(3, ScalarType::kFloat64);
  Cluster piece;
  for (uint32_t t = 0; t < 5000; ++t) {
    piece.in.triangles.push_back({t, t + 1, t + 2});
    piece.removers.push_back(kDrain);
  }
  for (uint32_t v = 0; v < 5002; ++v) {
    piece.in.positions.push_back({0, 0, 0});
    piece.in.vertices.push_back(v);
  }
  for (const AttributeLayout& attributes : {AttributeLayout{}, layout}) {
    piece.in.rows.assign(5002 * attributes.row_bytes(), std::byte{0});
    Meter meter(kRoot, [&](ByteSpan payload) {
      static_cast<void>(DecodeRootPiece(payload, attributes, 5002, "test"));
    });
    const Bytes payload = EncodeRootPiece(piece, attributes);
    REQUIRE(DecodeRootPiece(payload, attributes, 5002, "test").ok());
    meter.TryAll(payload, 300);
    // Streams of zeros: a triangle whose corners are all new, and so on.
    StreamWriter streams;
    ByteWriter& head = streams.stream(StreamTag::kHead);
    for (const uint64_t count : {50'000, 66'000, 0}) head.PutVarint(count);
    for (const StreamTag tag :
         {StreamTag::kRootVertices, StreamTag::kRootTriangles, StreamTag::kArcs,
          StreamTag::kExplicitArcs, StreamTag::kAttributes}) {
      // As far as a frame may expand.
      Bytes& bytes = streams.stream(tag).bytes();
      bytes.assign(200'000, std::byte{0});
      for (size_t i = 0; i < bytes.size(); i += 1000)
        bytes[i] = static_cast<std::byte>(i / 1000 & 1);
    }
    meter.TryAll(streams.Finish(), 300);
  }
}

TEST_CASE("records, entries and index rows take memory by their bytes", "[memory]") {
  ObjectRecord record;
  record.id = ObjectId{1};
  record.name = "n";
  record.bounds = {{0, 0, 0}, {1, 1, 1}};
  Meter record_meter(kRecord,
                     [](ByteSpan bytes) { static_cast<void>(DecodeObjectRecord(bytes, "test")); });
  for (const size_t attributes : {size_t{3}, kMaxAttributes, size_t{100'000}}) {
    for (const size_t rounds : {0, 4, 20'000}) {
      record.attributes = Many(attributes);
      record.rounds.resize(rounds);
      record_meter.TryAll(EncodeObjectRecord(record), 20);
    }
  }
  Meter entry_meter(kEntry, [](ByteSpan bytes) {
    static_cast<void>(DecodePendingEntry(bytes, "test"));
    static_cast<void>(DecodeSuperblock(bytes, "test"));
  });
  entry_meter.TryAll(EncodePendingEntry({std::string(500, 'n'), 7}), 300);
  entry_meter.TryAll(EncodeSuperblock({2, uint64_t{1} << 40, 3}), 300);

  ClusterIndex index;
  std::vector<UnitId> children;
  for (uint32_t c = 0; c < 512; ++c) {
    UnitEntry entry;
    entry.round = 1;
    entry.hilbert = c;
    entry.bounds.Add(Vec3i{0, 0, 0});
    entry.nodes = 1;
    index.Add(entry, {c, 0, 1}, children);
    children.push_back(c);
  }
  for (const uint32_t count : {512u, 40u, 0xffffffffu}) {
    Meter meter(kIndex, [&](ByteSpan bytes) {
      ClusterIndex decoded;
      static_cast<void>(DecodeIndexRows(bytes, count, "test", &decoded));
      decoded.Finish(1);
    });
    meter.TryAll(EncodeIndexRows(index, 0, std::min(count, 512u)), 100);
  }
}

namespace {

class NoSink final : public MeshSink {
 public:
  explicit NoSink(bool joins) : joins_(joins) {}
  Status Begin(const MeshHeader&) override { return Status::Ok(); }
  Status AddVertices(std::span<const Vec3d>, ByteSpan) override { return Status::Ok(); }
  Status AddTriangles(std::span<const TriangleVertices>) override { return Status::Ok(); }
  Status End() override { return Status::Ok(); }
  bool joins_soup() const override { return joins_; }

 private:
  const bool joins_;
};

Bytes Text(const std::string& text) {
  const ByteSpan bytes = AsBytes(text);
  return {bytes.begin(), bytes.end()};
}

}  // namespace

TEST_CASE("mesh files take memory by their bytes", "[memory]") {
  const int descriptor = ::memfd_create("mesh", 0);
  const std::string path = "/proc/self/fd/" + std::to_string(descriptor);
  const auto meter_of = [&](auto read, bool joins, const Bound& bound = kMeshFile) {
    return Meter(bound, [&path, descriptor, read, joins](ByteSpan bytes) {
      REQUIRE(::ftruncate(descriptor, 0) == 0);
      REQUIRE(::pwrite(descriptor, bytes.data(), bytes.size(), 0) ==
              static_cast<ssize_t>(bytes.size()));
      const auto file = InputFile::Open(path);
      REQUIRE(file.ok());
      NoSink sink(joins);
      MeshReadReport report;
      static_cast<void>(read(**file, sink, &report));
    });
  };
  // With a start that says nothing.
  const auto with_start = [](auto read) {
    return [read](const InputFile& file, MeshSink& sink, MeshReadReport* report) {
      return read(file, MeshFileStart{}, sink, report);
    };
  };
  const std::string vertex = "property float x\nproperty float y\nproperty float z\n";
  const std::string list = "property list int int vertex_indices\n";
  for (const bool joins : {false, true}) {
    {
      Meter meter = meter_of(with_start(ReadPly), joins, kPolygonFile);
      for (const std::string format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
        const std::string head = "ply\nformat " + format + " 1.0\n";
        for (const std::string count : {"3", "1000000000", "18446744073709551615"}) {
          std::string many;
          for (int i = 0; i < 5'000; ++i) many += "property char a" + std::to_string(i) + "\n";
          for (const std::string& more : {std::string(), many}) {
            const std::string text = head + "element vertex " + count + "\n" + vertex + more +
                                     "element face " + count + "\n" + list + "end_header\n";
            // Many properties take long to read: each is compared with those before.
            const int changes = more.empty() ? 40 : 1;
            meter.TryAll(Text(text + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"), changes);
            meter.TryAll(Text(text + std::string(50'000, '\x7f')), changes / 8);
            meter.Try(Text(text + std::string(50'000, '9')));
          }
        }
        std::string elements;
        for (int i = 0; i < 5'000; ++i) elements += "element e" + std::to_string(i) + " 1\n";
        meter.Try(Text(head + elements));
      }
      meter.Try(Text("ply\nformat ascii 1.0\ncomment " + std::string(1 << 20, 'c')));
    }
    {
      Meter meter = meter_of(with_start(ReadGltf), joins, kGltfFile);
      const std::string square =
          R"({"asset":{"version":"2.0"},"buffers":[{"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAA)"
          R"(AAAAAAAAAAAAAAAAgD8AAAAA"}],"bufferViews":[{"buffer":0,"byteLength":36}],)"
          R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],)"
          R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]})";
      meter.TryAll(Text(square), 40);
      for (const std::string part : {"[", "[],", "0,", "{},", "\"\",", "[0],", R"({"a":0},)"}) {
        std::string many = R"({"nodes":[)";
        while (many.size() < 200'000) many += part;
        meter.Try(Text(many));
        meter.Try(Text(many + "0]}"));
      }
      std::string keys = "{";
      for (int i = 0; i < 20'000; ++i) keys += "\"" + std::to_string(i) + "\":0,";
      meter.Try(Text(keys + "\"\":0}"));
      std::string bytes = square;
      bytes.replace(bytes.find("AAAA"), 4, std::string(400'000, 'A'));
      meter.Try(Text(bytes));
    }
    {
      Meter meter = meter_of(ReadDraco, joins, kDracoFile);
      for (const char method : {'\0', '\1'}) {
        for (const std::string count : {"\x05", "\xff\x1f", "\xff\xff\xff\xff\x07"}) {
          std::string file = std::string("DRACO\2\2\1", 8) + method + std::string(2, '\0');
          if (method == '\1') file += '\0';
          meter.TryAll(Text(file + count + count + std::string(200, '\1')), 40);
        }
      }
    }
    {
      Meter meter = meter_of(with_start(ReadObj), joins, kPolygonFile);
      std::string polygon = "f";
      for (int i = 0; i < 100'000; ++i) polygon += " 1";
      std::string ears = "f";
      for (int i = 0; i < 100'000; ++i) ears += " " + std::to_string(1 + i % 3);
      for (const std::string& text :
           {std::string("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "v 0 0 0\n" + polygon + "\n",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + ears + "\n", std::string(1 << 20, ' '),
            "f " + std::string(1 << 20, '1'),
            std::string("f 1 2 \\\n") + std::string(1 << 19, '\\')}) {
        meter.TryAll(Text(text), 20);
      }
    }
    {
      Meter meter = meter_of(with_start(ReadOff), joins, kPolygonFile);
      for (const std::string& text : {std::string("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
                                      std::string("OFF\n4000000000 4000000000 0\n0 0 0\n"),
                                      std::string("OFF\n1 1 0\n0 0 0\n4000000000 0 0 0\n")}) {
        meter.TryAll(Text(text), 60);
      }
    }
    for (const auto read : {ReadBinaryStl, ReadAsciiStl}) {
      Meter meter = meter_of(read, joins);
      std::string binary(80, ' ');
      binary += std::string("\xff\xff\xff\x7f", 4) + std::string(50 * 2000, '\1');
      std::string ascii = "solid s\n";
      for (int i = 0; i < 2000; ++i) {
        const std::string n = std::to_string(i);
        ascii += "facet normal 0 0 1\nouter loop\nvertex 0 0 " + n + "\nvertex 1 0 " + n +
                 "\nvertex 0 1 " + n + "\nendloop\nendfacet\n";
      }
      for (const std::string& text : {binary, ascii}) meter.TryAll(Text(text), 20);
    }
  }
  ::close(descriptor);
}

}  // namespace mtdb::testing
