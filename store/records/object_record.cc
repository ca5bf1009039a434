// SPDX-License-Identifier: Apache-2.0
#include "store/object_record.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

#include "store/base/attribute_layout.h"
#include "store/base/texture.h"
#include "store/object_name.h"
#include "store/records/keys.h"
#include "store/texture_pages.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr uint16_t kRecordVersion = 1;
constexpr uint8_t kMustUnderstand = 0x80;
constexpr size_t kMostMediaTypeBytes = 255;

enum Tag : uint8_t {
  kIdentity = 0x81,
  kGrid = 0x82,
  kAttributes = 0x83,
  kPlace = 0x84,
  kInput = 0x05,
  kMesh = 0x86,
  kStructure = 0x87,
  kRounds = 0x08,
  kOptions = 0x09,
  kDigests = 0x8a,
  kRaster = 0x8b,
  kView = 0x0c,
  kSheets = 0x8d,
  kOrientation = 0x0e,
  kTexture = 0x8f,
};
constexpr uint16_t kSections = 10;  // of every object

void PutVec(const Vec3d& v, ByteWriter* w) {
  for (int i = 0; i < 3; ++i) w->Put(v[i]);
}

void PutSection(Tag tag, ByteWriter section, ByteWriter* record) {
  record->Put(static_cast<uint8_t>(tag));
  record->PutVarint(section.size());
  record->PutBytes(section.bytes());
}

// Reads the fields of a record; the first violation is kept.
class RecordReader {
 public:
  RecordReader(ByteSpan bytes, std::string where) : r_(bytes), where_(std::move(where)) {}

  bool ok() const { return status_.ok() && !r_.failed(); }
  size_t remaining() const { return r_.remaining(); }
  void Fail(const std::string& message) {
    if (ok())
      status_ = Corrupt(where_ + ": byte " + std::to_string(r_.position()) + ": " + message);
  }
  Status Finish() {
    if (status_.ok() && r_.failed()) status_ = Corrupt(where_ + ": the record ends too early");
    if (status_.ok() && r_.remaining() != 0) {
      status_ = Corrupt(where_ + ": expected the end, found " + std::to_string(r_.remaining()) +
                        " more bytes");
    }
    return status_;
  }

  template <typename T>
  T Get() {
    return r_.Get<T>();
  }
  ByteSpan GetBytes(uint64_t count) { return r_.GetBytes(count); }
  uint64_t Get64() { return r_.GetVarint(); }
  int64_t GetSigned() { return r_.GetSignedVarint(); }
  std::string GetString() { return r_.GetString(); }
  uint32_t Get32(const char* what) {
    const uint64_t v = r_.GetVarint();
    if (v > std::numeric_limits<uint32_t>::max()) {
      Fail(std::string(what) + ": expected 32 bits, found " + std::to_string(v));
    }
    return static_cast<uint32_t>(v);
  }
  uint8_t GetAtMost(uint8_t most, const char* what) {
    const auto v = r_.Get<uint8_t>();
    if (v > most) {
      Fail(std::string(what) + ": expected at most " + std::to_string(most) + ", found " +
           std::to_string(v));
      return 0;
    }
    return v;
  }
  double GetFinite(const char* what) {
    const auto v = r_.Get<double>();
    if (!std::isfinite(v)) Fail(std::string(what) + ": expected a finite number");
    return v;
  }
  Vec3d GetVec(const char* what) {
    Vec3d v;
    for (int i = 0; i < 3; ++i) v[i] = GetFinite(what);
    return v;
  }
  double GetPositive(const char* what) {
    const double v = GetFinite(what);
    if (ok() && !(v > 0)) Fail(std::string(what) + ": expected a number above 0");
    return v;
  }
  AttributeLayout GetLayout() {
    Result<AttributeLayout> layout = GetAttributeLayout(&r_);
    if (layout.ok()) return *std::move(layout);
    Fail(layout.status().message());
    return {};
  }
  // True when `count` items of at least `bytes` bytes each can follow.
  bool Fits(uint64_t count, size_t bytes, const char* what) {
    if (ok() && count > r_.remaining() / bytes) {
      Fail(std::string(what) + ": " + std::to_string(count) + " do not fit the " +
           std::to_string(r_.remaining()) + " bytes that remain");
    }
    return ok();
  }

 private:
  ByteReader r_;
  std::string where_;
  Status status_;
};

// ---- sections: each Put beside its Get ----------------------------------------------------------

ByteWriter PutIdentity(const ObjectRecord& o) {
  ByteWriter w;
  w.Put(o.id.value);
  w.PutString(o.name);
  return w;
}
void GetIdentity(RecordReader* r, ObjectRecord* o) {
  o->id = ObjectId{r->Get<uint64_t>()};
  o->name = r->GetString();
  if (o->id.value == 0) r->Fail("object id: expected one above 0");
  if (o->name.empty() || o->name.size() > kMaxNameBytes) {
    r->Fail("name: expected 1 to 500 bytes, found " + std::to_string(o->name.size()));
  }
}

ByteWriter PutGrid(const ObjectRecord& o) {
  ByteWriter w;
  w.Put(static_cast<uint8_t>(o.grid.mode));
  PutVec(o.grid.origin, &w);
  w.Put(o.grid.step);
  w.Put(o.grid.error_unit);
  w.Put(o.bits);
  w.Put(static_cast<uint8_t>(static_cast<uint8_t>(o.error_measure) | (o.border_moves ? 2 : 0)));
  w.Put(o.rounding_error);
  return w;
}
void GetGrid(RecordReader* r, ObjectRecord* o) {
  o->grid.mode = static_cast<PositionMode>(r->GetAtMost(2, "position mode"));
  o->grid.origin = r->GetVec("origin");
  o->grid.step = r->GetPositive("step");
  o->grid.error_unit = r->GetPositive("error unit");
  o->bits = r->GetAtMost(32, "bits");
  const uint8_t measure = r->GetAtMost(3, "error measure");
  o->error_measure = static_cast<ErrorMeasure>(measure & 1);
  o->border_moves = (measure & 2) != 0;
  if (measure == 2) r->Fail("error measure: expected 0, 1 or 3, found 2");
  o->rounding_error = r->GetFinite("rounding error");
  if (r->ok() && o->rounding_error < 0)
    r->Fail("rounding error: expected one that is not negative");
}

ByteWriter PutAttributes(const ObjectRecord& o) {
  ByteWriter w;
  PutAttributeLayout(o.attributes, &w);
  w.Put(static_cast<uint8_t>(o.double_positions));
  return w;
}
void GetAttributes(RecordReader* r, ObjectRecord* o) {
  o->attributes = r->GetLayout();
  o->double_positions = r->GetAtMost(1, "double positions") != 0;
}

ByteWriter PutPlace(const ObjectRecord& o) {
  ByteWriter w;
  PutVec(o.bounds.min, &w);
  PutVec(o.bounds.max, &w);
  w.PutString(o.units);
  w.PutString(o.georeference);
  return w;
}
void GetPlace(RecordReader* r, ObjectRecord* o) {
  o->bounds.min = r->GetVec("bounds");
  o->bounds.max = r->GetVec("bounds");
  o->units = r->GetString();
  o->georeference = r->GetString();
}

ByteWriter PutInput(const ObjectRecord& o) {
  const InputReport& in = o.input;
  ByteWriter w;
  for (const uint64_t v :
       {in.vertices, in.triangles, in.unreferenced_vertices, in.degenerate_triangles,
        in.duplicate_triangles, in.nonmanifold_edges, in.nonmanifold_vertices}) {
    w.PutVarint(v);
  }
  return w;
}
void GetInput(RecordReader* r, ObjectRecord* o) {
  InputReport& in = o->input;
  for (uint64_t* v :
       {&in.vertices, &in.triangles, &in.unreferenced_vertices, &in.degenerate_triangles,
        &in.duplicate_triangles, &in.nonmanifold_edges, &in.nonmanifold_vertices}) {
    *v = r->Get64();
  }
}

ByteWriter PutMesh(const ObjectRecord& o) {
  ByteWriter w;
  for (const uint64_t v :
       {o.vertices, o.triangles, o.components, o.boundary_edges, o.boundary_loops}) {
    w.PutVarint(v);
  }
  w.PutSignedVarint(o.euler_characteristic);
  return w;
}
void GetMesh(RecordReader* r, ObjectRecord* o) {
  for (uint64_t* v :
       {&o->vertices, &o->triangles, &o->components, &o->boundary_edges, &o->boundary_loops}) {
    *v = r->Get64();
  }
  o->euler_characteristic = r->GetSigned();
}

ByteWriter PutStructure(const ObjectRecord& o) {
  ByteWriter w;
  w.PutVarint(o.nodes);
  w.PutVarint(o.clusters);
  w.PutVarint(o.root_pieces);
  w.PutVarint(o.root_vertices);
  w.PutVarint(o.root_triangles);
  w.PutVarint(o.depth);
  w.PutVarint(o.max_degree);
  w.Put(o.error_code_max);
  return w;
}
void GetStructure(RecordReader* r, ObjectRecord* o) {
  o->nodes = r->Get64();
  o->clusters = r->Get32("clusters");
  o->root_pieces = r->Get32("root pieces");
  o->root_vertices = r->Get64();
  o->root_triangles = r->Get64();
  o->depth = r->Get32("depth");
  o->max_degree = r->Get32("largest degree");
  o->error_code_max = r->Get<uint8_t>();
}

constexpr size_t kMinRoundBytes = 9;
ByteWriter PutRounds(const ObjectRecord& o) {
  ByteWriter w;
  w.PutVarint(o.rounds.size());
  for (const RoundReport& x : o.rounds) {
    for (const uint64_t v : {x.triangles_in, x.triangles_out, x.tiles, x.clusters, x.nodes,
                             x.locked_vertices, x.stuck_topology, x.stuck_degree}) {
      w.PutVarint(v);
    }
    w.Put(x.error_code_max);
  }
  return w;
}
void GetRounds(RecordReader* r, ObjectRecord* o) {
  const uint64_t count = r->Get64();
  if (!r->Fits(count, kMinRoundBytes, "rounds")) return;
  o->rounds.assign(count, {});
  for (RoundReport& x : o->rounds) {
    for (uint64_t* v : {&x.triangles_in, &x.triangles_out, &x.tiles, &x.clusters, &x.nodes,
                        &x.locked_vertices, &x.stuck_topology, &x.stuck_degree}) {
      *v = r->Get64();
    }
    x.error_code_max = r->Get<uint8_t>();
  }
}

ByteWriter PutOptions(const ObjectRecord& o) {
  ByteWriter w;
  w.PutVarint(o.degree_limit);
  w.PutVarint(o.tile_triangles);
  return w;
}
void GetOptions(RecordReader* r, ObjectRecord* o) {
  o->degree_limit = r->Get32("degree limit");
  o->tile_triangles = r->Get32("tile size");
}

ByteWriter PutDigests(const ObjectRecord& o) {
  ByteWriter w;
  w.Put(o.surface_digest);
  w.Put(o.border_digest);
  w.PutVarint(o.payload_bytes);
  w.PutVarint(o.stored_bytes);
  w.Put(o.index_checksum);
  w.Put(o.digest_low);
  w.Put(o.digest_high);
  return w;
}
void GetDigests(RecordReader* r, ObjectRecord* o) {
  o->surface_digest = r->Get<uint64_t>();
  o->border_digest = r->Get<uint64_t>();
  o->payload_bytes = r->Get64();
  o->stored_bytes = r->Get64();
  o->index_checksum = r->Get<uint64_t>();
  o->digest_low = r->Get<uint64_t>();
  o->digest_high = r->Get<uint64_t>();
}

ByteWriter PutRaster(const ObjectRecord& o) {
  const RasterFrame& f = *o.raster;
  ByteWriter w;
  for (const double v : o.grid.plane) w.Put(v);
  w.PutVarint(f.columns);
  w.PutVarint(f.rows);
  for (const double v : f.geotransform) w.Put(v);
  w.Put(static_cast<uint8_t>((f.transform_of_samples ? 1 : 0) | (f.is_area ? 2 : 0) |
                             (f.nodata ? 4 : 0)));
  w.Put(f.nodata.value_or(0));
  for (const std::string* s : {&f.sample_type, &f.height_units, &f.vertical_datum}) {
    w.PutString(*s);
  }
  w.PutVarint(f.filled);
  return w;
}
void GetRaster(RecordReader* r, ObjectRecord* o) {
  RasterFrame& f = o->raster.emplace();
  for (double& v : o->grid.plane) v = r->GetFinite("plane");
  f.columns = r->Get32("columns");
  f.rows = r->Get32("rows");
  for (double& v : f.geotransform) v = r->GetFinite("geotransform");
  const uint8_t flags = r->GetAtMost(7, "flags of the raster");
  f.transform_of_samples = (flags & 1) != 0;
  f.is_area = (flags & 2) != 0;
  const auto nodata = r->Get<double>();
  if ((flags & 4) != 0) f.nodata = nodata;
  f.sample_type = r->GetString();
  f.height_units = r->GetString();
  f.vertical_datum = r->GetString();
  f.filled = r->Get64();
  const auto& p = o->grid.plane;
  constexpr uint32_t kMost = uint32_t{1} << 30;
  if (r->ok() && (f.columns == 0 || f.rows == 0 || f.columns > kMost || f.rows > kMost)) {
    r->Fail("raster: expected 1 to 2^30 columns and rows, found " + std::to_string(f.columns) +
            " x " + std::to_string(f.rows));
  }
  if (r->ok() && !(p[0] * p[3] - p[1] * p[2] > 0)) {
    r->Fail("plane: expected a positive determinant");
  }
}

ByteWriter PutView(const ObjectRecord& o) {
  ByteWriter w;
  PutVec(o.up->direction, &w);
  w.Put(static_cast<uint8_t>(o.up->given ? 1 : 0));
  return w;
}
void GetView(RecordReader* r, ObjectRecord* o) {
  ObjectUp& up = o->up.emplace();
  up.direction = r->GetVec("up");
  if (r->ok() && std::fabs(Length(up.direction) - 1) > 1e-6) {
    r->Fail("up: expected a vector of length 1");
  }
  up.given = r->GetAtMost(1, "where up is from") != 0;
}

ByteWriter PutSheets(const ObjectRecord& o) {
  ByteWriter w;
  w.PutVarint(o.input.two_sided_triangles);
  return w;
}
void GetSheets(RecordReader* r, ObjectRecord* o) { o->input.two_sided_triangles = r->Get64(); }

ByteWriter PutOrientation(const ObjectRecord& o) {
  ByteWriter w;
  for (const uint64_t v :
       {o.input.inconsistent_edges, o.input.turned_triangles, o.input.unorientable_sheets}) {
    w.PutVarint(v);
  }
  return w;
}
void GetOrientation(RecordReader* r, ObjectRecord* o) {
  o->input.inconsistent_edges = r->Get64();
  o->input.turned_triangles = r->Get64();
  o->input.unorientable_sheets = r->Get64();
}

ByteWriter PutTexture(const ObjectRecord& o) {
  const TextureRecord& t = *o.texture;
  ByteWriter w;
  for (const double v : {t.step, t.scale, t.rounding}) w.Put(v);
  w.PutVarint(t.pages.size());
  for (const TextureRecord::Page& page : t.pages) {
    w.PutString(page.name);
    w.PutString(page.media_type);
    for (const uint64_t v : {uint64_t{page.width}, uint64_t{page.height}, page.bytes}) {
      w.PutVarint(v);
    }
    w.Put(page.checksum);
  }
  w.PutVarint(t.tiles.bytes);
  w.Put(t.tiles.checksum);
  return w;
}
// What readers make of it, and call files.
void CheckPage(const TextureRecord::Page& page, RecordReader* r) {
  if (const Status name = CheckPageName(page.name); !name.ok()) r->Fail(name.message());
  if (page.media_type.size() > kMostMediaTypeBytes ||
      !std::ranges::all_of(page.media_type, [](char c) { return c > ' ' && c <= '~'; })) {
    r->Fail("texture: expected media types of ASCII letters");
  }
  if (page.bytes > kMostPageBytes || (page.bytes == 0 && page.checksum != 0)) {
    r->Fail("texture: page " + page.name + ": expected up to 2^30 bytes, and no checksum without " +
            "any, found " + std::to_string(page.bytes));
  }
}
constexpr size_t kMinPageBytes = 14;
void GetTexture(RecordReader* r, ObjectRecord* o) {
  TextureRecord& t = o->texture.emplace();
  for (double* v : {&t.step, &t.scale, &t.rounding}) {
    *v = r->GetFinite("texture");
    if (r->ok() && *v < 0) r->Fail("texture: expected numbers that are not negative");
  }
  const uint64_t count = r->Get64();
  if (!r->Fits(count, kMinPageBytes, "pages")) return;
  if (count > kMostPages) r->Fail("texture: " + std::to_string(count) + " pages");
  if (!r->ok()) return;
  t.pages.assign(count, {});
  for (TextureRecord::Page& page : t.pages) {
    page.name = r->GetString();
    page.media_type = r->GetString();
    page.width = r->Get32("width of a page");
    page.height = r->Get32("height of a page");
    page.bytes = r->Get64();
    page.checksum = r->Get<uint64_t>();
    if (!r->ok()) return;
    CheckPage(page, r);
  }
  t.tiles.bytes = r->Get64();
  t.tiles.checksum = r->Get<uint64_t>();
  if (t.tiles.bytes > kMostTileBytes || (t.tiles.bytes == 0 && t.tiles.checksum != 0)) {
    r->Fail("texture: expected up to 2^40 bytes of tiles, and no checksum without any, found " +
            std::to_string(t.tiles.bytes));
  }
}

struct SectionCodec {
  Tag tag;
  ByteWriter (*put)(const ObjectRecord&);
  void (*get)(RecordReader*, ObjectRecord*);
};

// Ascending by number without the must-understand bit: the order in a record.
constexpr SectionCodec kCodecs[kSections] = {
    {kIdentity, PutIdentity, GetIdentity},
    {kGrid, PutGrid, GetGrid},
    {kAttributes, PutAttributes, GetAttributes},
    {kPlace, PutPlace, GetPlace},
    {kInput, PutInput, GetInput},
    {kMesh, PutMesh, GetMesh},
    {kStructure, PutStructure, GetStructure},
    {kRounds, PutRounds, GetRounds},
    {kOptions, PutOptions, GetOptions},
    {kDigests, PutDigests, GetDigests},
};
// Sections that not every object has, behind the others.
constexpr std::array kMoreCodecs = {SectionCodec{kRaster, PutRaster, GetRaster},
                                    SectionCodec{kView, PutView, GetView},
                                    SectionCodec{kSheets, PutSheets, GetSheets},
                                    SectionCodec{kOrientation, PutOrientation, GetOrientation},
                                    SectionCodec{kTexture, PutTexture, GetTexture}};

}  // namespace

std::string ObjectRecord::digest_hex() const {
  char text[33];
  std::snprintf(text, sizeof(text), "%016llx%016llx", static_cast<unsigned long long>(digest_high),
                static_cast<unsigned long long>(digest_low));
  return text;
}

std::string UnitLabel(const ObjectRecord& record, UnitId unit) {
  return unit < record.clusters ? "cluster " + std::to_string(unit)
                                : "root piece " + std::to_string(unit - record.clusters);
}

Bytes EncodeObjectRecord(const ObjectRecord& record) {
  ByteWriter w;
  w.Put(kRecordVersion);
  w.Put(uint16_t{0});
  const bool sheets = record.input.two_sided_triangles != 0;
  const bool orientation = record.input.inconsistent_edges != 0 ||
                           record.input.turned_triangles != 0 ||
                           record.input.unorientable_sheets != 0;
  w.Put(static_cast<uint16_t>(kSections + (record.raster ? 1 : 0) + (record.up ? 1 : 0) +
                              (sheets ? 1 : 0) + (orientation ? 1 : 0) + (record.texture ? 1 : 0)));
  for (const SectionCodec& codec : kCodecs) PutSection(codec.tag, codec.put(record), &w);
  if (record.raster) PutSection(kRaster, PutRaster(record), &w);
  if (record.up) PutSection(kView, PutView(record), &w);
  if (sheets) PutSection(kSheets, PutSheets(record), &w);
  if (orientation) PutSection(kOrientation, PutOrientation(record), &w);
  if (record.texture) PutSection(kTexture, PutTexture(record), &w);
  return w.Take();
}

Result<ObjectRecord> DecodeObjectRecord(ByteSpan bytes, const std::string& where) {
  RecordReader r(bytes, where);
  const auto version = r.Get<uint16_t>();
  const auto flags = r.Get<uint16_t>();
  const auto sections = r.Get<uint16_t>();
  if (r.ok() && (version != kRecordVersion || flags != 0)) {
    return Unsupported(where + ": object record version " + std::to_string(version) + ", flags " +
                       std::to_string(flags) + "; this program reads version 1 without flags");
  }
  ObjectRecord record;
  size_t known = 0;
  int last_number = -1;
  for (uint32_t i = 0; i < sections && r.ok(); ++i) {
    const auto tag = r.Get<uint8_t>();
    const uint64_t length = r.Get64();
    if (!r.Fits(length, 1, "section")) break;
    const ByteSpan body = r.GetBytes(length);
    const int number = tag & ~kMustUnderstand;
    if (number <= last_number) r.Fail("section tags: expected ascending ones");
    last_number = number;
    const SectionCodec* codec = nullptr;
    for (const SectionCodec& c : kCodecs) {
      if (c.tag == tag) codec = &c;
    }
    if (codec != nullptr) ++known;
    for (const SectionCodec& c : kMoreCodecs) {
      if (c.tag == tag) codec = &c;
    }
    if (codec == nullptr) {
      if ((tag & kMustUnderstand) == 0) continue;
      return Unsupported(where + ": section " + std::to_string(tag) +
                         " of the object record is unknown; use a newer program");
    }
    RecordReader section(body, where + ": section " + std::to_string(tag));
    codec->get(&section, &record);
    MTDB_RETURN_IF_ERROR(section.Finish());
  }
  if (r.ok() && known != kSections) {
    r.Fail("expected " + std::to_string(kSections) + " known sections, found " +
           std::to_string(known));
  }
  if (r.ok() && record.raster.has_value() != (record.grid.mode == PositionMode::kRaster)) {
    r.Fail("position mode: expected 2 with a section of the raster, and no other mode");
  }
  MTDB_RETURN_IF_ERROR(r.Finish());
  return record;
}

}  // namespace mtdb
