// SPDX-License-Identifier: Apache-2.0
// The verbs of mtdb as functions. Each prints its result to standard output; an error is returned
// and printed by main.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "builder/build.h"
#include "store/base/status.h"
#include "store/database.h"
#include "tools/render/render.h"
#include "tools/request/arguments.h"
#include "tools/request/query_options.h"
#include "tools/server/server.h"

namespace mtdb {

struct IngestArguments {
  std::vector<std::string> inputs;  // "-": standard input
  std::string format;               // of standard input; empty: its content tells it
  std::string store;
  std::string name;
  std::optional<int> bits;
  std::optional<double> step;
  std::optional<double> step_z;  // rasters
  std::optional<uint32_t> fill;  // rasters
  bool lossless = false;
  bool terrain = false;  // the meshes are height fields
  std::optional<Vec3d> up;
  std::string units;
  std::optional<double> weld;
  bool keep_apart = false;
  std::optional<int> normal_bits;
  std::vector<AttributeStep> attribute_steps;
  unsigned threads = 0;
  std::string tmp;                        // folder of temporary files; empty: the store's
  std::optional<uint64_t> memory_bytes;   // none: a quarter of the machine's
  std::optional<uint64_t> max_tmp_bytes;  // of temporary files; none: as many as the disk takes
  bool resume = false;
  std::string resume_command;  // the command line that goes on with this ingest
  bool dry_run = false;
  bool force = false, quiet = false, json = false, verbose = false;
};
// Prints what the inputs are like, and what an ingest would make of them; stores nothing.
Status Survey(const IngestArguments& arguments);
Status Ingest(const IngestArguments& arguments);

struct InspectArguments {
  std::string store;
  OpenOptions open;
  std::string name;
  std::string level = "fast";  // verify
  bool streams = false;        // info: read all payloads, and tell what their streams take
  std::string format;          // info: of a mesh on standard input
  std::string tmp;             // list: where journals lie; empty: the store's folder
  bool json = false;
};
Status Info(const InspectArguments& arguments);
Status List(const InspectArguments& arguments);
// `*ok` is false when a check failed; the Status is an error when nothing could be examined.
Status Verify(const InspectArguments& arguments, bool* ok);

// Verbs that change which objects a store has, and how much room they take.
struct SpaceArguments {
  std::string store;
  std::string target;              // copy: another store
  std::vector<std::string> names;  // remove, copy: the objects (copy: none are all); rename: both
  bool force = false;              // copy: replace objects of the same names
  bool json = false;
  bool quiet = false;  // no progress
};
Status Remove(const SpaceArguments& arguments);
Status Rename(const SpaceArguments& arguments);
Status Copy(const SpaceArguments& arguments);
Status Compact(const SpaceArguments& arguments);

struct PackArguments {
  std::string from;  // pack: a store; unpack: a packed file or its URL
  OpenOptions open;  // of `from`
  std::string to;
  std::vector<std::string> names;  // none: all
  bool force = false;              // unpack: replaces objects
  bool json = false;
  bool quiet = false;  // no progress
};
Status Pack(const PackArguments& arguments);
Status Unpack(const PackArguments& arguments);

struct QueryArguments {
  std::string store;          // fetch: a URL
  OpenOptions open;           // not fetch
  std::string output;         // "-": standard output
  std::string output_format;  // of standard output
  std::string name;
  QueryOptions query;
  bool print_query = false;
  bool quiet = false;                   // nothing is told
  bool implicit = false;                // the cache keeps clusters as in the store; not fetch
  std::optional<uint64_t> cache_bytes;  // none: a quarter of the machine's; not fetch
  bool json = false;
  bool verbose = false;
  bool double_positions = false;  // extract, fetch: .ply
  Extent size{1200, 900};         // render
  RenderOptions picture;          // render: but for its size, frame, direction and up
  std::string view = "auto";      // render: of kViewNames
  double exaggerate = 1;          // render: z is drawn so many times as high
  bool overview = false;          // render: not what the camera sees
  double timeout_seconds = 600;   // fetch: without progress
  // Extract: of a raster that a terrain becomes.
  std::optional<std::array<double, 2>> spacing;
  std::optional<std::array<double, 4>> window;
  std::string drape;  // extract, render: an image; empty: none
};
// With an output that is a raster's.
Status ExtractRaster(const QueryArguments& arguments);
Status ExtractVerb(const QueryArguments& arguments);
Status RenderVerb(const QueryArguments& arguments);
Status Fetch(const QueryArguments& arguments);

struct FollowArguments {
  std::string url;
  std::string path;    // a file of keyframes
  std::string output;  // a pattern of mesh files; empty: none
  std::string csv;     // empty: none
  std::string name;
  uint32_t remembered_vertices = 65536;
  double timeout_seconds = 600;
  double reconnect_seconds = 0;
  bool json = false;
};
Status Follow(const FollowArguments& arguments);

// Prints the URL once it can be asked; returns when a signal ends it.
Status Serve(const ServerOptions& options);
// Likewise with `page` behind the URL, and then calls `listening` with what it printed.
Status ServeAndTell(const ServerOptions& options, const std::string& page,
                    const std::function<void(const std::string& url)>& listening);

struct ViewArguments {
  std::string store;
  OpenOptions open;
  std::optional<Endpoint> listen;  // none: `port` on 127.0.0.1
  uint16_t port = 0;               // 0: any free one
  bool browser = true;
  std::string drape;                 // an image; empty: none
  std::string page;                  // the folder, to write the page only
  std::vector<std::string> sources;  // origins of files that it may read then, beside its own
};
// Serves the store on this machine, and has the desktop's browser show it; or writes the page.
Status View(const ViewArguments& arguments);

struct ProbeArguments {
  std::string store;
  OpenOptions open;
  std::string name;
  std::optional<Vec3d> point;                  // either this
  std::optional<Ray> ray;                      // or this
  std::vector<std::array<double, 2>> heights;  // or these, of a terrain
  std::string heights_file;                    // or those of a file; "-": standard input
  std::optional<double> error;
  std::optional<double> limit;
  bool json = false;
};
Status Probe(const ProbeArguments& arguments);
// Those with heights.
Status ProbeHeights(const ProbeArguments& arguments);

struct ProfileArguments {
  std::string store;
  OpenOptions open;
  std::string name;
  std::vector<std::array<double, 2>> line;
  std::optional<double> error;
  bool json = false;
};
Status ProfileVerb(const ProfileArguments& arguments);

// Texts of these options; kInvalidArgument says what was expected.
Result<std::array<double, 2>> ParsePlace(const std::string& text);              // "X,Y"
Result<std::vector<std::array<double, 2>>> ParseLine(const std::string& text);  // two or more
Result<std::array<double, 2>> ParseSpacing(const std::string& text);            // "D", "DX,DY"
Result<std::array<double, 4>> ParseWindow(const std::string& text);             // two corners

struct GenerateArguments {
  std::string shape;
  std::string output;
  uint64_t triangles = 0;
  uint64_t seed = 1;
  bool json = false;
};
Status Generate(const GenerateArguments& arguments);

}  // namespace mtdb
