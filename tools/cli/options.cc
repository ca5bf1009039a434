// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/options.h"

#include <array>
#include <string_view>

#include "query/query_json.h"
#include "store/database.h"
#include "tools/render/view.h"
#include "tools/request/arguments.h"
#include "tools/request/query_options.h"

namespace mtdb {

CLI::Option* IsWritten(CLI::Option* option) {
  return option->check([](const std::string& text) {
    return Database::IsUrl(text) ? text + ": a URL cannot be written to; give a file" : "";
  });
}

void AddUpAndUnits(CLI::App* verb, std::optional<Vec3d>* up, std::string* units) {
  AddParsed(verb, "--up", "AXIS", up, ParseUp,
            "what is up in pictures and in the viewer: x, y, z, -x, -y, -z (as --up=-y), or a "
            "vector X,Y,Z (default: found from the shape; terrains: z)");
  AddParsed(verb, "--units", "UNIT", units, ParseLengthUnit,
            "what coordinates are in: um, mm, cm, m, km, in or ft; kept and shown, and changes no "
            "number");
}

void AddName(CLI::App* verb, std::string* name, const char* description) {
  verb->add_option("--name", *name, description)->type_name("NAME");
}

void AddJson(CLI::App* verb, bool* json) {
  verb->add_flag("--json", *json, "print the result as JSON");
}

void AddCacheDirectory(CLI::App* verb, OpenOptions* options) {
  CLI::Option* folder =
      verb->add_option("--cache-dir", options->cache_directory,
                       "keep what is read of a URL in DIR, so that it need not come again; "
                       "processes may share DIR")
          ->type_name("DIR");
  AddParsed(verb, "--cache-dir-size", "SIZE", &options->cache_directory_bytes, ParseSize,
            "keep at most so much there; what was not used for longest goes first")
      ->default_str("4G")
      ->needs(folder);
}

void AddVerbose(CLI::App* verb, bool* verbose) {
  verb->add_flag("--verbose", *verbose, "tell all that is known of the work that was done");
}

namespace {

struct Background {
  std::optional<Rgb> colour;
  bool transparent = false;
};

Result<Background> ParseBackground(const std::string& text) {
  if (text == "transparent") return Background{std::nullopt, true};
  if (text == "white") return Background{Rgb{255, 255, 255}};
  if (text == "black") return Background{Rgb{0, 0, 0}};
  if (text == "grey" || text == "gray") return Background{Rgb{128, 128, 128}};
  constexpr const char* kHexDigits = "0123456789abcdefABCDEF";
  if (text.size() == 7 && text[0] == '#' &&
      text.find_first_not_of(kHexDigits, 1) == std::string::npos) {
    const auto value = static_cast<uint32_t>(std::stoul(text.substr(1), nullptr, 16));
    return Background{Rgb{static_cast<uint8_t>(value >> 16), static_cast<uint8_t>(value >> 8),
                          static_cast<uint8_t>(value)}};
  }
  return Unexpected(text, "white, black, grey, transparent or #RRGGBB");
}

Result<std::array<double, 2>> ParseRange(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, ParseNumbers(text, 2, "LEAST,MOST"));
  if (n[0] > n[1]) return Unexpected(text, "LEAST,MOST, with LEAST at most MOST");
  return std::array{n[0], n[1]};
}

void SetColouring(const std::string& text, RenderOptions* picture) {
  constexpr std::string_view kAttribute = "attribute:";
  if (text == "none") {
    picture->colour_by = ColourBy::kNothing;
  } else if (text == "normal") {
    picture->colour_by = ColourBy::kNormal;
  } else if (text == "height") {
    picture->colour_by = ColourBy::kHeight;
  } else if (text == "error") {
    picture->colour_by = ColourBy::kDistance;
  } else {
    picture->colour_by = ColourBy::kAttribute;
    picture->attribute = text.starts_with(kAttribute) ? text.substr(kAttribute.size()) : text;
  }
}

void AddAccuracyOptions(CLI::App* verb, QueryOptions* q) {
  const char* group = "How accurate (several: all must hold)";
  auto* full =
      verb->add_flag("--full", q->full, "full resolution: the input's triangles (default)");
  auto* error = AddParsed(verb, "--error", "E", &q->error, ParseNonNegative,
                          "coarser: within E of the surface, in model units");
  auto* relative = AddParsed(verb, "--error-rel", "F", &q->error_relative, ParseNonNegative,
                             "the same as a fraction of the bounding box's diagonal");
  auto* pixels = AddParsed(verb, "--pixels", "P", &q->pixels, ParsePositive,
                           "what the camera sees is off by at most P pixels");
  auto* at = AddParsedList(
      verb, "--error-at", "LAW,X,Y,Z,BASE,F", &q->errors_at, ErrorAtOption,
      "by the distance r from a point; LAW is linear (BASE + F r), quadratic (BASE + F r^2), sqrt "
      "(BASE + F sqrt r) or exp (BASE exp(F r))");
  auto* outside = AddParsed(verb, "--error-outside", "E", &q->error_outside, ParseNonNegative,
                            "within E outside of the region too, not as coarse as possible");
  auto* triangles = AddParsed(verb, "--triangles", "N", &q->triangles, ParseCount,
                              "at most N triangles, as accurate as they allow");
  auto* bytes = AddParsed(verb, "--max-bytes", "SIZE", &q->max_bytes, ParseSize,
                          "read at most SIZE of the store's clusters, as accurate as they allow");
  auto* time = AddParsed(verb, "--max-ms", "MS", &q->max_ms, ParseNonNegative,
                         "stop refining after MS milliseconds");
  for (auto* option : {error, relative, pixels, at, triangles}) full->excludes(option);
  error->excludes(relative);
  for (auto* option : {full, error, relative, pixels, at, outside, triangles, bytes, time}) {
    option->group(group);
  }
}

void AddRegionOptions(CLI::App* verb, QueryOptions* q) {
  const char* group = "Where (several: in any of them; elsewhere as coarse as possible)";
  const auto add = [&](const char* name, const char* form, auto parse, const char* description) {
    AddParsedList(verb, name, form, &q->regions, parse, description)->group(group);
  };
  add("--box", "X0,Y0,Z0,X1,Y1,Z1", BoxOption, "a box, by two corners");
  add("--sphere", "X,Y,Z,R", SphereOption, "a ball, by centre and radius");
  add("--half-space", "X,Y,Z,NX,NY,NZ", HalfSpaceOption,
      "what is behind the plane through X,Y,Z that faces NX,NY,NZ");
  add("--prism", "X0,Y0,X1,Y1,...", PrismOption, "above and below a polygon");
  add("--wedge", "X,Y,DX,DY,ANGLE[,FAR]", WedgeOption,
      "above and below a wedge at X,Y that looks along DX,DY, ANGLE degrees wide");
  add("--point", "X,Y,Z", PointRegionOption, "a point");
  add("--segment", "X0,Y0,Z0,X1,Y1,Z1", SegmentOption, "a segment: a line of sight");
  add("--tube", "R,X0,Y0,Z0,X1,Y1,Z1,...", TubeOption, "what is within R of a line through points");
  verb->add_flag("--frustum", q->frustum, "what the camera sees")->group(group);
  verb->add_flag("--intersect", q->intersect, "what lies in all of the regions, not in any")
      ->group(group);
  verb->add_flag("--outside", q->outside, "what lies outside of all that")->group(group);
  verb->add_flag("--clip", q->clip, "leave out the triangles that do not meet the region")
      ->group(group);
}

void AddCameraOptions(CLI::App* verb, QueryOptions* q, bool draws) {
  const char* group = "The camera";
  const auto add = [&](const char* name, const char* form, auto* value, auto parse,
                       const char* description) {
    AddParsed(verb, name, form, value, parse, description)->group(group);
  };
  add("--eye", "X,Y,Z", &q->eye, PointOption, "where it is");
  add("--target", "X,Y,Z", &q->target, PointOption, "what it looks at");
  add("--up", "X,Y,Z", &q->up, PointOption,
      draws ? "what is up in the picture, also without a camera (default with a camera: 0,0,1)"
            : "what is up in its picture (default: 0,0,1)");
  add("--fov", "DEGREES", &q->fov, ParsePositive,
      "the angle from the bottom to the top of its picture (default: 45)");
  add("--viewport", "WxH", &q->viewport, ParseExtent,
      "its picture's size in pixels (default: 1200x900; render: --size)");
}

}  // namespace

void AddQueryOptions(CLI::App* verb, QueryArguments* a, bool draws) {
  AddName(verb, &a->name, "which object; needed when the store has several");
  AddAccuracyOptions(verb, &a->query);
  AddRegionOptions(verb, &a->query);
  AddCameraOptions(verb, &a->query, draws);
  verb->add_option("--query", a->query.file,
                   "region and threshold from a JSON file (docs/query.md), or - for standard "
                   "input: all that the options below say, and more")
      ->type_name("FILE");
  verb->add_flag("--print-query", a->print_query,
                 "print the query as JSON, for --query, and do nothing else");
  AddJson(verb, &a->json);
  AddVerbose(verb, &a->verbose);
  // Called when the verb's arguments are complete.
  verb->callback([a, draws] {
    Status status = CheckOptions(a->query, draws);
    if (status.ok() && a->view != "auto" && a->query.has_camera() && !a->overview) {
      status = InvalidArgument("--view: does not go with --eye, which says where to look from");
    }
    // A query of options alone depends on nothing else; of the object's size only by a factor.
    if (status.ok() && a->query.file.empty()) {
      const auto json = QueryOf(a->query, a->size);
      status = json.ok() ? ParseQuery(json->dump(), 1).status() : json.status();
    }
    if (status.ok() && a->output == "-" && a->output_format.empty()) {
      status = InvalidArgument("-: standard output has no suffix: give --format, such as ply");
    }
    if (status.ok() && a->output != "-" && !a->output_format.empty()) {
      status = InvalidArgument("--format: is of standard output (-): a file's suffix says it");
    }
    if (!status.ok()) throw CLI::ValidationError(status.message());
  });
}

namespace {

// What its colours mean.
void AddColourOptions(CLI::App* verb, const char* group, QueryArguments* a) {
  verb->add_option_function<std::string>(
          "--colour", [a](const std::string& text) { SetColouring(text, &a->picture); },
          "colour by: an attribute's name; height, by tints as of maps; error, the distance from "
          "the surface at full resolution; normal; or none (default: the scan's red, green, blue; "
          "of a terrain height). attribute:NAME is "
          "an attribute, whatever its name")
      ->type_name("WHAT")
      ->group(group);
  verb->add_option("--drape", a->drape,
                   "with this image over it, where it lies: a PNG or JPEG with a world file beside "
                   "it, a GeoTIFF")
      ->type_name("FILE")
      ->group(group);
  AddParsed(verb, "--range", "LEAST,MOST", &a->picture.range, ParseRange,
            "the values of the first and the last colour (default: those that there are)")
      ->group(group);
}

}  // namespace

void AddPictureOptions(CLI::App* verb, QueryArguments* a) {
  const char* group = "The picture";
  AddParsed(verb, "--size", "WxH", &a->size, ParseExtent, "width and height in pixels")
      ->default_str("1200x900")
      ->group(group);
  verb->add_option("--view", a->view,
                   "without a camera, look from: front, back, left, right, top, bottom, iso, or "
                   "auto, which shows the broader side from above, and a terrain as a map; --up "
                   "says what is up "
                   "(default: found from the shape)")
      ->type_name("SIDE")
      ->check(CLI::IsMember(std::vector<std::string>(kViewNames.begin(), kViewNames.end())))
      ->default_str("auto")
      ->group(group);
  AddColourOptions(verb, group, a);
  verb->add_option_function<std::string>(
          "--background",
          [a](const std::string& text) {
            const Result<Background> background = ParseBackground(text);
            if (!background.ok()) {
              throw CLI::ValidationError("--background", background.status().message());
            }
            a->picture.background = background->colour;
            a->picture.transparent = background->transparent;
          },
          "white, black, grey, #RRGGBB, or transparent (default: a dark gradient)")
      ->type_name("COLOUR")
      ->group(group);
  const auto flag = [&](const char* name, bool* value, const char* description) {
    verb->add_flag(name, *value, description)->group(group);
  };
  AddParsed(verb, "--exaggerate", "F", &a->exaggerate, ParsePositive,
            "draw heights (z) F times as high; what is asked for, legends and errors stay as they "
            "are (default: 1)")
      ->group(group);
  flag("--hillshade", &a->picture.hillshade,
       "light as of maps, from the north-west (default for a terrain without --colour)");
  flag("--wireframe", &a->picture.wireframe, "draw the edges of the triangles");
  flag("--smooth", &a->picture.smooth, "shade triangles as parts of a smooth surface");
  flag("--scale-bar", &a->picture.scale_bar,
       "draw a round length, true at the depth of the object's middle");
  verb->add_flag_callback(
          "--no-legend", [a] { a->picture.legend = false; }, "leave out the legend of the colours")
      ->group(group);
  flag("--draft", &a->picture.draft, "fast: no shadows, no soft edges");
  flag("--overview", &a->overview,
       "draw the whole object as without a camera, not what the camera sees");
}

void AddProbe(CLI::App* verb, ProbeArguments* a) {
  verb->add_option("STORE", a->store, "the store file")->required();
  AddName(verb, &a->name, "which object; needed when the store has several");
  auto* point = AddParsed(verb, "--point", "X,Y,Z", &a->point, ParsePoint,
                          "find the closest point of the surface to this one");
  AddParsed(verb, "--ray", "X,Y,Z,DX,DY,DZ", &a->ray, ParseRay,
            "find where this ray, of origin and direction, first meets the surface")
      ->excludes(point);
  AddParsedList(verb, "--height", "X,Y", &a->heights, ParsePlace,
                "of a terrain: the height there; may be repeated")
      ->excludes("--point")
      ->excludes("--ray");
  verb->add_option("--heights", a->heights_file,
                   "of a terrain: the heights at the places of a file, X,Y a line, or of - for "
                   "standard input")
      ->type_name("FILE")
      ->excludes("--point")
      ->excludes("--ray")
      ->excludes("--height");
  AddParsed(verb, "--error", "E", &a->error, ParseNonNegative,
            "on a surface within E of the input, in model units (default: full resolution)");
  AddParsed(verb, "--limit", "D", &a->limit, ParseNonNegative,
            "look no farther: a distance, or for rays a multiple of the direction");
  AddJson(verb, &a->json);
  verb->callback([a] {
    if (!a->point && !a->ray && a->heights.empty() && a->heights_file.empty()) {
      throw CLI::ValidationError("probe", "give --point, --ray, --height or --heights");
    }
  });
}

void AddView(CLI::App* verb, ViewArguments* a) {
  CLI::Option* store =
      verb->add_option("STORE", a->store, "the store file, or a packed file or its URL");
  CLI::Option* page =
      verb->add_option("--write-page", a->page,
                       "only write the page's files into DIR, for any web server: beside them, "
                       "index.html?src=FILE shows a packed file")
          ->type_name("DIR");
  verb->add_option("--allow-source", a->sources,
                   "let the page of --write-page also read files of ORIGIN, as "
                   "https://example.org (repeatable)")
      ->type_name("ORIGIN")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->needs(page);
  verb->callback([store, page, a] {
    if (store->count() + page->count() == 0) throw CLI::RequiredError("STORE");
    if (store->count() * page->count() > 0) {
      throw CLI::ValidationError(
          "--write-page writes the page alone, without STORE; beside it: "
          "mtdb pack STORE " +
          a->page + "/scan.mtdbp, which index.html?src=scan.mtdbp shows");
    }
  });
  AddParsed(verb, "--listen", "WHERE", &a->listen, ParseEndpoint,
            "ADDRESS:PORT, or PORT on 127.0.0.1, as for serve: whoever can connect can read the "
            "whole store");
  verb->add_option("--port", a->port, "listen on this port (default: any free one)")
      ->type_name("N")
      ->check(CLI::Range(1, 65535))
      ->excludes("--listen");
  verb->add_flag_callback(
      "--no-browser", [a] { a->browser = false; }, "only print the URL");
  verb->add_option("--drape", a->drape,
                   "lay IMAGE, a PNG or JPEG with a world file or a GeoTIFF, over the surface")
      ->type_name("IMAGE")
      ->excludes(page);
}

void AddProfile(CLI::App* verb, ProfileArguments* a) {
  verb->add_option("STORE", a->store, "the store file")->required();
  AddName(verb, &a->name, "which object; needed when the store has several");
  AddParsed(verb, "--line", "X0,Y0,X1,Y1,...", &a->line, ParseLine,
            "the line's corners, in the terrain's coordinates")
      ->required();
  AddParsed(verb, "--error", "E", &a->error, ParseNonNegative,
            "no height off by more than E (default: full resolution)");
  AddJson(verb, &a->json);
}

void AddImplicit(CLI::App* verb, bool* implicit) {
  verb->add_flag("--implicit", *implicit,
                 "keep clusters in memory as in the store, some 15 times smaller than decoded, and "
                 "decode what a query needs each time anew; the answers are the same");
}

namespace {

// How long what may take, who may come, and where temporary files go.
void AddServeTimes(CLI::App* verb, ServerOptions* o) {
  AddParsed(verb, "--idle", "SECONDS", &o->idle_seconds, ParsePositiveSeconds,
            "close a connection that is silent for so long")
      ->default_str("30");
  AddParsed(verb, "--session-idle", "SECONDS", &o->session_idle_seconds, ParsePositiveSeconds,
            "close a session whose client has said nothing for so long, nor answered a ping")
      ->default_str("300");
  AddParsed(verb, "--timeout", "SECONDS", &o->timeout_seconds, ParsePositiveSeconds,
            "give up a request that takes longer, its sending included")
      ->default_str("600");
  AddParsed(verb, "--grace", "SECONDS", &o->grace_seconds, ParseSeconds,
            "when told to stop, let running requests finish for so long")
      ->default_str("5");
  verb->add_option("--allow-origin", o->allowed_origin,
                   "let web pages of this origin open sessions, e.g. http://localhost:3000; * is "
                   "any (default: those that come from the server's own address only)")
      ->type_name("ORIGIN");
  verb->add_option("--allow-host", o->allowed_hosts,
                   "let clients call the server by this name, e.g. scans.example.org; * is any "
                   "(default: by address and localhost only)")
      ->type_name("NAME");
  verb->add_option("--tmp", o->service.tmp, "folder of temporary files (default: the system's)")
      ->type_name("DIR");
}

}  // namespace

void AddServe(CLI::App* verb, ServerOptions* o) {
  verb->add_option("STORE", o->service.store, "the store file, or a packed file or its URL")
      ->required();
  const auto number = [&](const char* name, auto* value, auto smallest, auto largest,
                          const char* description) {
    return verb->add_option(name, *value, description)
        ->type_name("N")
        ->check(CLI::Range(smallest, largest));
  };
  AddParsed(verb, "--listen", "WHERE", &o->listen, ParseEndpoint,
            "ADDRESS:PORT, or PORT on 127.0.0.1; port 0 is any free one. Whoever can connect can "
            "read the whole store: there are no passwords")
      ->default_str("127.0.0.1:8080");
  number("--threads", &o->threads, 1, 1024, "answer N queries at once (default: one per core)");
  AddParsed(verb, "--cache", "SIZE", &o->service.cache_bytes, ParseSize,
            "keep decoded clusters of so much memory for each open object")
      ->default_str("256M");
  AddImplicit(verb, &o->service.implicit);
  number("--max-objects", &o->service.objects, 1, 10000, "keep the last N objects open")
      ->capture_default_str();
  number("--max-connections", &o->max_connections, 1, 100000,
         "take at most N connections; others are told to try again")
      ->capture_default_str();
  number("--max-sessions", &o->max_sessions, 1, 100000,
         "open at most N sessions among them; others are told to try again")
      ->capture_default_str();
  AddParsed(verb, "--max-triangles", "N", &o->service.max_triangles, ParseCount,
            "send no mesh of more triangles")
      ->default_str("20000000");
  AddParsed(verb, "--session-triangles", "N", &o->service.session_triangles, ParseCount,
            "let no session's mesh have more triangles; each takes some 250 to 700 bytes here")
      ->default_str("1000000");
  AddParsed(verb, "--session-memory", "SIZE", &o->service.session_memory_bytes, ParseSize,
            "let all sessions together take so much memory; then the largest give way")
      ->default_str("2G");
  AddParsed(verb, "--max-tmp", "SIZE", &o->service.temporary_bytes, ParseSize,
            "let all answers under way take so much of temporary files; then the largest give way")
      ->default_str("4G");
  AddServeTimes(verb, o);
}

}  // namespace mtdb
