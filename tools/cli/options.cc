// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/options.h"

#include "codecs/mesh_file/mesh_file.h"
#include "query/query_from_json.h"
#include "store/database.h"
#include "tools/cli/raster_output.h"
#include "tools/client/client.h"

namespace mtdb {

VerbOption IsWritten(VerbOption option) {
  return option.Check([](const std::string& text) {
    return Database::IsUrl(text) ? text + ": a URL cannot be written to; give a file" : "";
  });
}

void AddStore(VerbOptions* verb, std::string* store) {
  verb->Add("STORE", *store, "the store file, or a packed file or its URL").Required();
}

void AddWrittenStore(VerbOptions* verb, std::string* store) {
  IsWritten(verb->Add("STORE", *store, "the store file")).Required();
}

void AddUrl(VerbOptions* verb, std::string* url) {
  verb->Add("URL", *url, "http://HOST:PORT or http://HOST:PORT/objects/NAME")
      .Required()
      .Check([](const std::string& text) { return CheckUrl(text).message(); });
}

void AddTimeout(VerbOptions* verb, double* seconds) {
  AddParsed(verb, "--timeout", "SECONDS", seconds, ParsePositiveSeconds,
            "give up when the server does nothing for so long")
      .Default("600");
}

void AddInputFormat(VerbOptions* verb, std::string* format) {
  verb->Add("--format", *format,
            "the format of standard input, where its content does not tell it: " +
                SuffixesOf(ReadMeshFormats()) + ", without the dot")
      .Form("FORMAT")
      .Check([](const std::string& text) { return FindReadMeshFormat(text).status().message(); });
}

void AddOutput(VerbOptions* verb, std::string* output, bool may_be_standard, bool may_be_raster) {
  const std::string what = "the mesh file: " + SuffixesOf(WrittenMeshFormats()) +
                           (may_be_standard ? ", or - for standard output (see --format)" : "") +
                           (may_be_raster ? "; of a terrain also a raster: .tif, .asc, .hgt" : "");
  IsWritten(verb->Add("OUTPUT", *output, what)).Required().Check([=](const std::string& text) {
    if (may_be_standard && text == "-") return std::string();
    if (may_be_raster && IsRasterOutput(text)) return std::string();
    return WrittenMeshFormatOf(text).status().message();
  });
}

void AddName(VerbOptions* verb, std::string* name) {
  verb->Add("--name", *name, "which object; needed when there are several").Form("NAME");
}

void AddOnly(VerbOptions* verb, std::string* name) {
  verb->Add("--name", *name, "this object only").Form("NAME");
}

void AddJson(VerbOptions* verb, bool* json) {
  verb->AddFlag("--json", *json, "print the result as JSON");
}

void AddVerbose(VerbOptions* verb, bool* verbose) {
  verb->AddFlag("--verbose", *verbose, "tell all that is known of the work that was done");
}

void AddCacheDirectory(VerbOptions* verb, OpenOptions* options) {
  VerbOption folder =
      verb->Add("--cache-directory", options->cache_directory,
                "keep what is read of a URL in DIR, so that it need not come again; "
                "processes may share DIR")
          .Form("DIR");
  AddParsed(verb, "--cache-directory-bytes", "SIZE", &options->cache_directory_bytes, ParseSize,
            "keep at most so much there; what was not used for longest goes first")
      .Default("4G")
      .Needs(folder);
}

void AddImplicit(VerbOptions* verb, bool* implicit) {
  verb->AddFlag("--implicit", *implicit,
                "keep clusters in memory as in the store, some 15 times smaller than decoded, and "
                "decode what a query needs each time anew; the answers are the same");
}

void AddRegionsAlone(VerbOptions* verb, QueryOptions* q, const char* heading) {
  for (const RegionOption& o : RegionOptions()) {
    AddParsedList(verb, o.name, o.form, &q->regions, o.parse, o.description).Group(heading);
  }
  verb->AddFlag("--intersect", q->intersect, "what lies in all of the regions, not in any")
      .Group(heading);
  verb->AddFlag("--outside", q->outside, "what lies outside of all that").Group(heading);
}

namespace {

void AddAccuracyOptions(VerbOptions* verb, QueryOptions* q) {
  const char* group = "How accurate (several: all must hold)";
  const VerbOption full =
      verb->AddFlag("--full", q->full, "full resolution: the input's triangles (default)");
  const VerbOption error =
      AddParsed(verb, "--error", "E", &q->error, ParseError,
                "coarser: within E of the surface, in model units, or E% of the "
                "bounding box's diagonal");
  const VerbOption pixels = AddParsed(verb, "--pixels", "P", &q->pixels, ParsePositive,
                                      "what the camera sees is off by at most P pixels");
  const VerbOption at = AddParsedList(
      verb, "--error-at", "LAW,X,Y,Z,BASE,F", &q->errors_at, ErrorAtOption,
      "by the distance r from a point; LAW is linear (BASE + F r), quadratic (BASE + F r^2), sqrt "
      "(BASE + F sqrt r) or exp (BASE exp(F r))");
  const VerbOption outside =
      AddParsed(verb, "--error-outside", "E", &q->error_outside, ParseError,
                "within E outside of the region too, not as coarse as possible");
  const VerbOption triangles = AddParsed(verb, "--triangles", "N", &q->triangles, ParseCount,
                                         "at most N triangles, as accurate as they allow");
  const VerbOption bytes =
      AddParsed(verb, "--max-bytes", "SIZE", &q->max_bytes, ParseSize,
                "read at most SIZE of the store's clusters, as accurate as they allow");
  const VerbOption time = AddParsed(verb, "--max-milliseconds", "MS", &q->max_milliseconds,
                                    ParseNonNegative, "stop refining after MS milliseconds");
  for (const VerbOption option : {error, pixels, at, triangles}) full.Excludes(option);
  for (const VerbOption option : {full, error, pixels, at, outside, triangles, bytes, time}) {
    option.Group(group);
  }
}

void AddRegionOptions(VerbOptions* verb, QueryOptions* q) {
  const char* group = "Where (several: in any of them; elsewhere as coarse as possible)";
  AddRegionsAlone(verb, q, group);
  verb->AddFlag("--frustum", q->frustum, "what the camera sees").Group(group);
  verb->AddFlag("--clip", q->clip, "leave out the triangles that do not meet the region")
      .Group(group);
}

void AddCameraOptions(VerbOptions* verb, QueryOptions* q, bool draws) {
  const char* group = "The camera";
  const auto add = [&](const char* name, const char* form, auto* value, auto parse,
                       const char* description) {
    AddParsed(verb, name, form, value, parse, description).Group(group);
  };
  add("--eye", "X,Y,Z", &q->eye, ParsePoint, "where it is");
  add("--target", "X,Y,Z", &q->target, ParsePoint, "what it looks at");
  add("--up", "X,Y,Z", &q->up, ParsePoint,
      draws ? "what is up in the picture, also without a camera (default with a camera: 0,0,1)"
            : "what is up in its picture (default: 0,0,1)");
  add("--fov", "DEGREES", &q->fov, ParsePositive,
      "the angle from the bottom to the top of its picture (default: 45)");
  add("--viewport", "WxH", &q->viewport, ParseExtent,
      "its picture's size in pixels (default: 1200x900; render: --size)");
}

}  // namespace

void AddQueryOptions(VerbOptions* verb, QueryArguments* a, bool draws) {
  AddName(verb, &a->name);
  AddAccuracyOptions(verb, &a->query);
  AddRegionOptions(verb, &a->query);
  AddCameraOptions(verb, &a->query, draws);
  verb->Add("--query", a->query.file,
            "region and threshold from a JSON file (docs/query.md), or - for standard "
            "input: all that the options below say, and more")
      .Form("FILE");
  verb->AddFlag("--print-query", a->print_query,
                "print the query as JSON, for --query, and do nothing else");
  AddJson(verb, &a->json);
  AddVerbose(verb, &a->verbose);
  // Called when the verb's arguments are complete.
  verb->CheckAll([a, draws] {
    Status status = CheckOptions(a->query, draws);
    if (status.ok() && a->view != "auto" && a->query.has_camera() && !a->overview) {
      status = InvalidArgument("--view: does not go with --eye, which says where to look from");
    }
    // A query of options alone depends on nothing else; of the object's size only by a factor.
    if (status.ok() && a->query.file.empty()) {
      const auto json = QueryOf(a->query, a->size);
      status = json.ok() ? QueryFromJson(*json, 1).status() : json.status();
    }
    if (status.ok() && a->output == "-" && a->output_format.empty()) {
      status = InvalidArgument("-: standard output has no suffix: give --format, such as ply");
    }
    if (status.ok() && a->output != "-" && !a->output_format.empty()) {
      status = InvalidArgument("--format: is of standard output (-): a file's suffix says it");
    }
    return status;
  });
}

void AddMeshOptions(VerbOptions* verb, QueryArguments* a) {
  verb->AddFlag("--normals", a->query.normals,
                "add the mesh's normals to its vertices (to .off: also those that it has)");
  verb->AddFlag("--double-positions", a->double_positions,
                "to .ply: positions as float64 in any case");
}

}  // namespace mtdb
