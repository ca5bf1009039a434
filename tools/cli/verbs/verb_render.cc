// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <chrono>
#include <cstdio>
#include <unistd.h>

#include "query/heights.h"
#include "query/query_from_json.h"
#include "query/surface.h"
#include "tools/cli/grouped.h"
#include "tools/cli/options.h"
#include "tools/cli/progress.h"
#include "tools/cli/query_report.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/drape.h"
#include "tools/client/printable.h"
#include "tools/render/render.h"
#include "tools/render/view.h"
#include "tools/request/arguments.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

// Shows an object's shape, whatever its size.
constexpr double kOverviewError = 0.01;  // of the diagonal
constexpr uint64_t kOverviewTriangles = 20'000;
// What distances are measured from.
constexpr uint64_t kReferenceTriangles = 2'000'000;

using Clock = std::chrono::steady_clock;
double SecondsSince(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

constexpr double kMapAngle = 0.02;  // radians: as if seen from far above

// What a picture multiplies coordinates by.
Vec3d PictureScale(const ObjectRecord& record, const QueryArguments& arguments) {
  const std::array<double, 2> unit = MetresOfUnit(record);
  return {unit[0], unit[1], arguments.exaggerate};
}

void Stretch(Vec3d scale, TriangleMesh* mesh) {
  for (Vec3d& p : mesh->positions) p = Scaled(p, scale);
}

// Terrains without a colouring of their own are drawn as maps: tints or an image, a light from the
// north-west, and without a view or a camera from above.
void DrawAsMap(const QueryArguments& arguments, const ObjectRecord& record,
               RenderOptions* options) {
  if (IsTerrain(record) && options->colour == ColourBy::kOwn) {
    options->colour = options->drape ? ColourBy::kNothing : ColourBy::kHeight;
    options->hillshade = true;
  }
  if (options->colour != ColourBy::kHeight) return;
  options->height_scale = arguments.exaggerate;
  if (record.raster) options->height_units = record.raster->height_units;
  if (!options->range) options->range = {record.bounds.min.z, record.bounds.max.z};
}

// The image in the picture's coordinates.
Status ReadImage(const QueryArguments& arguments, const ObjectRecord& record,
                 RenderOptions* options) {
  if (arguments.drape.empty()) return Status::Ok();
  if (options->colour >= ColourBy::kNormal && options->colour != ColourBy::kHeight) {
    return InvalidArgument(
        "--drape: does not go with --colour error, normal or an attribute, whose colours stand for "
        "values");
  }
  MTDB_ASSIGN_OR_RETURN(MeshTexture texture, ReadDrape(arguments.drape, record));
  const Vec3d scale = PictureScale(record, arguments);
  for (const size_t i : {0, 3}) {
    texture.place[i + 1] /= scale.x;
    texture.place[i + 2] /= scale.y;
  }
  options->drape = std::move(texture);
  return Status::Ok();
}

// An error of the image's file names it.
Status NameImage(const QueryArguments& arguments, Status status) {
  const bool of_image =
      status.code() == StatusCode::kBadInput || status.code() == StatusCode::kUnsupported;
  if (!of_image || arguments.drape.empty()) return status;
  return Status(status.code(), arguments.drape + ": " + status.message());
}

Status ChooseCamera(const QueryArguments& arguments, Vec3d scale, RenderOptions* options) {
  MTDB_ASSIGN_OR_RETURN(Camera camera, CameraFromJson(CameraOf(arguments.query, arguments.size)));
  camera.eye = Scaled(camera.eye, scale);
  camera.direction = Scaled(camera.direction, scale);
  options->camera = camera;
  return Status::Ok();
}

// Pictures of one object share what is up, and their frame, but for clipped ones.
Status ChooseView(const QueryArguments& arguments, const Surface& surface, bool clipped,
                  RenderOptions* options) {
  const Vec3d scale = PictureScale(surface.record(), arguments);
  if (arguments.query.has_camera() && !arguments.overview) {
    return ChooseCamera(arguments, scale, options);
  }
  // A surface of its own: what the picture's query reads is counted apart.
  SurfaceOptions own;
  own.form = RuntimeForm::kImplicit;
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> apart, Surface::Open(surface.source(), own));
  Query query;
  query.threshold = ConstantThreshold(kOverviewError * surface.record().diagonal());
  query.max_triangles = kOverviewTriangles;
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MTDB_RETURN_IF_ERROR(apart->Extract(query, sink).status());
  Stretch(scale, &mesh);
  const bool heights = IsTerrain(surface.record());
  const std::optional<ObjectUp>& stored = surface.record().up;
  options->up = arguments.query.up ? *arguments.query.up
                : heights          ? Vec3d{0, 0, 1}
                : stored           ? stored->direction
                                   : EstimateUp(mesh);
  const bool map = options->hillshade && arguments.view == "auto";
  options->view_direction =
      ViewDirection(map ? "top" : arguments.view, options->up, mesh.positions);
  if (map) options->view_angle_rad = kMapAngle;
  if (!clipped) options->frame = std::move(mesh.positions);
  return Status::Ok();
}

// What the colours mean, for people.
std::string ColourText(const RenderOptions& options, const std::array<double, 2>& range,
                       const ExtractStats& reference) {
  char line[400];
  std::string what = options.attribute;
  if (options.colour == ColourBy::kHeight)
    what = options.height_units.empty() ? "height" : "height in " + options.height_units;
  if (options.colour == ColourBy::kDistance) {
    std::snprintf(line, sizeof(line),
                  "how far the picture's surface is from the best one of %s triangles",
                  Grouped(reference.triangles).c_str());
    what = line;
  }
  std::snprintf(line, sizeof(line), "  colours: %s; %.6g to %.6g\n", what.c_str(), range[0],
                range[1]);
  return line;
}

Json PictureJson(const QueryArguments& arguments, const RenderOptions& options,
                 const RenderImage& image) {
  const Vec3d up = options.camera ? options.camera->axes().up : options.up;
  const Vec3d direction = options.camera ? options.camera->axes().forward : options.view_direction;
  return {{"width_px", image.width},
          {"height_px", image.height},
          {"direction", Json(direction)},
          {"up", Json(up)},
          {"image", arguments.drape.empty() ? Json() : Json(arguments.drape)},
          {"colour_range", image.range ? Json(*image.range) : Json()}};
}

// Of images of the texture that are not in the picture, for people; empty: all are.
std::string UndrawnText(const ObjectRecord& record, const TextureTiles* tiles) {
  size_t count = 0, first = 0, pages = record.texture ? record.texture->pages.size() : 0;
  for (size_t i = 0; i < pages; ++i) {
    if (tiles != nullptr && tiles->pages()[i].levels > 0) continue;
    if (count++ == 0) first = i;
  }
  if (count == 0) return "";
  return "  " + std::to_string(count) + " of " + Counted(pages, "image", "images") +
         " of the texture cannot be drawn: " + Printable(record.texture->pages[first].name) +
         (count > 1 ? ", ...\n" : "\n");
}

Status Render(const QueryArguments& arguments) {
  const Clock::time_point begin = Clock::now();
  MTDB_ASSIGN_OR_RETURN(const Json json, QueryOf(arguments.query, arguments.size));
  if (arguments.print_query) {
    PrintJson(json);
    return Status::Ok();
  }
  MTDB_RETURN_IF_ERROR(CheckPictureName(arguments.output));
  // Of a terminal: somebody waits.
  ProgressLine progress(arguments.json || arguments.quiet || ::isatty(STDERR_FILENO) == 0);
  progress.Update(0, "reading");
  RenderOptions options = arguments.picture;
  options.width = arguments.size.width;
  options.height = arguments.size.height;
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Surface> surface, OpenSurface(arguments));
  const Vec3d scale = PictureScale(surface->record(), arguments);
  if (options.colour == ColourBy::kDistance && arguments.exaggerate != 1) {
    return InvalidArgument("--exaggerate: does not go with --colour error, which measures");
  }
  MTDB_RETURN_IF_ERROR(ReadImage(arguments, surface->record(), &options));
  DrawAsMap(arguments, surface->record(), &options);
  MTDB_ASSIGN_OR_RETURN(options.texture, TextureTiles::Open(surface->source()));
  MTDB_ASSIGN_OR_RETURN(const Query query, QueryFromJson(json, surface->record()));
  const double open_seconds = SecondsSince(begin);
  TriangleMesh mesh, reference;
  TriangleMeshSink sink(&mesh), reference_sink(&reference);
  MTDB_ASSIGN_OR_RETURN(const ExtractStats stats, surface->Extract(query, sink));
  Stretch(scale, &mesh);
  const Clock::time_point drawn = Clock::now();
  MTDB_RETURN_IF_ERROR(ChooseView(arguments, *surface, query.clip, &options));
  ExtractStats reference_stats;
  if (options.colour == ColourBy::kDistance) {
    Query best;
    best.max_triangles = kReferenceTriangles;
    MTDB_ASSIGN_OR_RETURN(reference_stats, surface->Extract(best, reference_sink));
    Stretch(scale, &reference);
    options.reference = &reference;
  }
  RenderImage image;
  progress.Update(0.5, "drawing " + Counted(mesh.triangles.size(), "triangle", "triangles"));
  MTDB_RETURN_IF_ERROR(NameImage(arguments, RenderMesh(mesh, options, &image)));
  MTDB_RETURN_IF_ERROR(WritePicture(arguments.output, image));
  progress.Finish();
  QueryReport report{json, surface->record(), stats};
  report.open_seconds = open_seconds;
  report.write_seconds = SecondsSince(drawn);
  report.total_seconds = SecondsSince(begin);
  report.picture = PictureJson(arguments, options, image);
  if (options.colour == ColourBy::kOwn) {
    report.remarks = UndrawnText(surface->record(), options.texture.get());
  }
  if (image.range) report.remarks = ColourText(options, *image.range, reference_stats);
  PrintQueryReport(arguments, report);
  return Status::Ok();
}

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
    picture->colour = ColourBy::kNothing;
  } else if (text == "normal") {
    picture->colour = ColourBy::kNormal;
  } else if (text == "height") {
    picture->colour = ColourBy::kHeight;
  } else if (text == "error") {
    picture->colour = ColourBy::kDistance;
  } else {
    picture->colour = ColourBy::kAttribute;
    picture->attribute = text.starts_with(kAttribute) ? text.substr(kAttribute.size()) : text;
  }
}

// What its colours mean.
void AddColourOptions(VerbOptions* verb, const char* group, QueryArguments* a) {
  verb->AddText(
          "--colour",
          [a](const std::string& text) {
            SetColouring(text, &a->picture);
            return Status::Ok();
          },
          "colour by: an attribute's name; height, by tints as of maps; error, the distance from "
          "the surface at full resolution; normal; or none (default: its texture, or the scan's "
          "red, green, blue; of a terrain height). attribute:NAME is an attribute, whatever its "
          "name")
      .Form("WHAT")
      .Group(group);
  verb->Add("--drape", a->drape,
            "with this image over it, where it lies: a PNG or JPEG with a world file beside "
            "it, a GeoTIFF")
      .Form("FILE")
      .Group(group);
  AddParsed(verb, "--range", "LEAST,MOST", &a->picture.range, ParseRange,
            "the values of the first and the last colour (default: those that there are)")
      .Group(group);
}

// After AddQueryOptions.
void AddPictureOptions(VerbOptions* verb, QueryArguments* a) {
  const char* group = "The picture";
  AddParsed(verb, "--size", "WxH", &a->size, ParseExtent, "width and height in pixels")
      .Default("1200x900")
      .Group(group);
  verb->Add("--view", a->view,
            "without a camera, look from: front, back, left, right, top, bottom, iso, or "
            "auto, which looks from the front and a little from the right, or shows a "
            "terrain as a map; --up says what is up (default: found from the shape)")
      .Form("SIDE")
      .OneOf(std::vector<std::string>(kViewNames.begin(), kViewNames.end()))
      .Default("auto")
      .Group(group);
  AddColourOptions(verb, group, a);
  verb->AddText(
          "--background",
          [a](const std::string& text) -> Status {
            const Result<Background> background = ParseBackground(text);
            if (!background.ok()) return background.status();
            a->picture.background = background->colour;
            a->picture.transparent = background->transparent;
            return Status::Ok();
          },
          "white, black, grey, #RRGGBB, or transparent (default: a dark gradient)")
      .Form("COLOUR")
      .Group(group);
  const auto flag = [&](const char* name, bool* value, const char* description) {
    verb->AddFlag(name, *value, description).Group(group);
  };
  AddParsed(verb, "--exaggerate", "F", &a->exaggerate, ParsePositive,
            "draw heights (z) F times as high; what is asked for, legends and errors stay as they "
            "are (default: 1)")
      .Group(group);
  flag("--hillshade", &a->picture.hillshade,
       "light as of maps, from the north-west (default for a terrain without --colour)");
  flag("--wireframe", &a->picture.wireframe, "draw the edges of the triangles");
  flag("--smooth", &a->picture.smooth, "shade triangles as parts of a smooth surface");
  flag("--scale-bar", &a->picture.scale_bar,
       "draw a round length, true at the depth of the object's middle");
  verb->AddFlag(
          "--no-legend", [a] { a->picture.legend = false; }, "leave out the legend of the colours")
      .Group(group);
  flag("--draft", &a->picture.draft, "fast: no shadows, no soft edges");
  flag("--overview", &a->overview,
       "draw the whole object as without a camera, not what the camera sees");
}

RunVerb AddRender(VerbOptions* verb) {
  const auto a = std::make_shared<QueryArguments>();
  AddStore(verb, &a->store);
  IsWritten(verb->Add("OUT.png", a->output, "the picture: .png, .jpg or .jpeg"))
      .Required()
      .Check([](const std::string& text) { return CheckPictureName(text).message(); });
  AddQueryOptions(verb, a.get(), true);
  AddCache(verb, &a->cache_bytes, kQuarterOfMemory);
  AddPictureOptions(verb, a.get());
  AddCacheDirectory(verb, &a->open);
  return [a](Invocation& invocation) {
    a->quiet = invocation.quiet;
    return Render(*a);
  };
}

}  // namespace

const Verb kRenderVerb{
    "render", "draw what extract would write",
    "Examples: mtdb render scans.mtdb coarse.png --error 0.2% --wireframe\n"
    "          mtdb render scans.mtdb error.png --colour error --error 0.2% "
    "--view top\n"
    "Where the surface is blue, its back is seen: the inside of an open scan, or "
    "triangles whose orientation\nis wrong in the input. More: docs/guide.md",
    AddRender};

}  // namespace mtdb
