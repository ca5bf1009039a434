// SPDX-License-Identifier: Apache-2.0
// ObjectRecord: what the catalog says of an object. Layout in store/FORMAT.md.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/grid.h"
#include "store/base/ids.h"
#include "store/base/raster_frame.h"
#include "store/base/status.h"

namespace mtdb {

// What the input had, and what of it could not be kept.
struct InputReport {
  uint64_t vertices = 0;               // as read
  uint64_t triangles = 0;              // as read, after polygons and strips were split
  uint64_t unreferenced_vertices = 0;  // dropped
  uint64_t degenerate_triangles = 0;   // two equal vertex indices; dropped
  uint64_t duplicate_triangles = 0;    // the same three vertices in the same orientation; dropped
  // Pairs of triangles back to back: of the same vertices, one the other way round. Both are kept,
  // and simplified as one two-sided triangle; it counts once below.
  uint64_t two_sided_triangles = 0;
  // Of more than two triangles, or of two that disagree about the surface's outside.
  uint64_t nonmanifold_edges = 0;
  // Of them, those of two triangles that run along them in the same direction; with
  // BuildOptions::orient, what is left of these.
  uint64_t inconsistent_edges = 0;
  // Where chains of such edges end or meet, or parts of the surface touch; they stay as long as
  // these do.
  uint64_t nonmanifold_vertices = 0;
  // A sheet is what hangs together across edges of two triangles.
  uint64_t turned_triangles = 0;     // turned over by BuildOptions::orient; repeated ones, too
  uint64_t unorientable_sheets = 0;  // have one side only, as a Moebius band
  friend bool operator==(const InputReport&, const InputReport&) = default;
};

// One round of the build, finest first.
struct RoundReport {
  uint64_t triangles_in = 0;
  uint64_t triangles_out = 0;
  uint64_t tiles = 0;
  uint64_t clusters = 0;
  uint64_t nodes = 0;
  uint64_t locked_vertices = 0;  // on seams of tiles; a vertex counts once for each of its tiles
  uint64_t stuck_topology = 0;   // vertices for which no legal removal exists
  uint64_t stuck_degree = 0;     // vertices with more neighbours than ObjectRecord::degree_limit
  uint8_t error_code_max = 0;
  friend bool operator==(const RoundReport&, const RoundReport&) = default;
};

// What an object's lengths may be said to be in.
inline constexpr std::array<std::string_view, 7> kLengthUnits = {"um", "mm", "cm", "m",
                                                                 "km", "in", "ft"};

// What is up, for those who draw the object.
struct ObjectUp {
  Vec3d direction{0, 0, 1};  // of length 1
  bool given = false;        // the user said so; else it was found (store/base/estimate_up.h)
  friend bool operator==(const ObjectUp&, const ObjectUp&) = default;
};

// Texture coordinates of the object's triangles, and their pages (store/base/texture.h).
struct TextureRecord {
  double step = 0;  // u and v are multiples of it; 0: as they came
  // Errors also bound how far images are displaced: by how much u and v differ from those of the
  // input's surface, times this scale (model units per unit of u and v).
  double scale = 0;
  double rounding = 0;  // the largest difference of u, v that rounding made
  struct Page {
    std::string name;
    std::string media_type;
    uint32_t width = 0, height = 0;  // pixels; 0: not known
    uint64_t bytes = 0;              // of the file; 0: the store has none
    uint64_t checksum = 0;           // likewise
    friend bool operator==(const Page&, const Page&) = default;
  };
  // A file of the texture: those of the pages, then that with the tiles of all pages
  // (store/texture_tiles.h).
  struct File {
    uint64_t bytes = 0;  // 0: the store has none
    uint64_t checksum = 0;
    friend bool operator==(const File&, const File&) = default;
  };
  std::vector<Page> pages;
  File tiles;

  uint32_t files() const { return static_cast<uint32_t>(pages.size()) + 1; }
  File file(uint32_t i) const {
    return i < pages.size() ? File{pages[i].bytes, pages[i].checksum} : tiles;
  }
  friend bool operator==(const TextureRecord&, const TextureRecord&) = default;
};

enum class ErrorMeasure : uint8_t { kTwoSidedDistance = 0, kVertical = 1 };

struct ObjectRecord {
  ObjectId id;
  std::string name;  // 1..500 bytes of UTF-8 without control characters

  Grid grid;
  uint8_t bits = 0;  // for coordinates along the longest side of the bounds; 32 when lossless
  // The largest displacement, in model units: no vertex of the input, and so no point of its
  // surface, was farther than this from its stored position. 0: the input lies on the grid.
  double rounding_error = 0;
  ErrorMeasure error_measure = ErrorMeasure::kTwoSidedDistance;
  // Of vertical errors: the border is simplified, too. An error then also bounds how far the border
  // has moved, in space, where lengths are in units of height (MetresOfUnit).
  bool border_moves = false;
  AttributeLayout attributes;
  bool double_positions = false;      // the stored positions are not all float32 values
  Box3d bounds;                       // model units, of the stored positions
  std::string units;                  // of lengths, one of kLengthUnits, or empty: not said
  std::string georeference;           // WKT2 or EPSG code as the file or the user said, or empty
  std::optional<RasterFrame> raster;  // PositionMode::kRaster only
  std::optional<TextureRecord> texture;
  std::optional<ObjectUp> up;  // none: of an older program, which did not find it

  InputReport input;
  uint64_t vertices = 0;   // of the full-resolution mesh (the drain)
  uint64_t triangles = 0;  // likewise
  uint64_t components = 0;
  uint64_t boundary_edges = 0;
  uint64_t boundary_loops = 0;
  int64_t euler_characteristic = 0;  // two-sided triangles count once

  uint64_t nodes = 0;
  uint32_t clusters = 0;
  uint32_t root_pieces = 0;
  uint64_t root_vertices = 0;
  uint64_t root_triangles = 0;
  uint32_t depth = 0;          // longest path of nodes in the DAG
  uint32_t max_degree = 0;     // the largest number of ring vertices of a node
  uint8_t error_code_max = 0;  // of any node
  std::vector<RoundReport> rounds;
  uint32_t degree_limit = 0;    // build option
  uint32_t tile_triangles = 0;  // build option

  // Sums over the full-resolution mesh on its grid that do not depend on the order of triangles
  // (store/base/surface_digest.h). `verify --level global` computes them again from the store.
  uint64_t surface_digest = 0;  // over triangles
  uint64_t border_digest = 0;   // over directed edges without a partner

  // Filled in by ObjectWriter::Publish.
  uint64_t payload_bytes = 0;   // of all units
  uint64_t stored_bytes = 0;    // of the pages that the object occupies
  uint64_t index_checksum = 0;  // of the cluster index, which has the checksum of every payload
  uint64_t digest_low = 0;      // 128 bits over payloads, index and record, but not id and name
  uint64_t digest_high = 0;

  double diagonal() const { return Diagonal(bounds); }
  // Vertices are numbered below this; nodes that bring a crumb without vertices leave gaps.
  uint64_t vertex_numbers() const { return root_vertices + nodes; }
  std::string digest_hex() const;
};

// True when both records are of one object. The id alone does not tell: a store never uses an id
// twice, but another store may be copied over the file.
inline bool IsSameObject(const ObjectRecord& a, const ObjectRecord& b) {
  return a.id == b.id && a.index_checksum == b.index_checksum && a.digest_low == b.digest_low &&
         a.digest_high == b.digest_high;
}

// "cluster 12" or "root piece 0", for messages.
std::string UnitLabel(const ObjectRecord& record, UnitId unit);

Bytes EncodeObjectRecord(const ObjectRecord& record);
// `where` names the record in messages.
Result<ObjectRecord> DecodeObjectRecord(ByteSpan bytes, const std::string& where);

}  // namespace mtdb
