// SPDX-License-Identifier: Apache-2.0
// Pictures, and servers in threads of their own, from C.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <string>

#include "tools/c/internal/handles.h"
#include "tools/c/internal/mesh.h"
#include "tools/c/internal/watch.h"
#include "tools/c/mtdb_show.h"
#include "tools/render/render.h"
#include "tools/render/view.h"
#include "tools/server/server.h"

// NOLINTNEXTLINE(readability-identifier-naming)
struct mtdb_server {
  std::unique_ptr<mtdb::BackgroundServer> server;
};

namespace mtdb::internal {

namespace {

constexpr uint32_t kMostPixels = 16384;

bool IsZero(const double v[3]) { return v[0] == 0 && v[1] == 0 && v[2] == 0; }

// Where the picture is seen from.
Status SetView(const mtdb_render_options& given, const TriangleMesh& mesh, RenderOptions* options) {
  for (const double* v : {given.frame_min, given.frame_max, given.view_direction, given.eye,
                          given.target, given.up}) {
    MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(v), "options"));
  }
  if (given.has_frame != 0) {
    const Box3d frame{ToVec(given.frame_min), ToVec(given.frame_max)};
    if (frame.empty()) return InvalidArgument("options.frame_min: exceeds frame_max");
    options->frame = CornersOf(frame);
  }
  if (given.has_camera != 0) {
    Camera camera;
    camera.eye = ToVec(given.eye);
    camera.direction = ToVec(given.target) - camera.eye;
    if (!IsZero(given.up)) camera.up = ToVec(given.up);
    if (given.fov != 0) camera.vertical_fov_rad = given.fov / 180 * std::numbers::pi;
    camera.width_px = options->width;
    camera.height_px = options->height;
    MTDB_RETURN_IF_ERROR(camera.Validate());
    options->camera = camera;
    return Status::Ok();
  }
  options->up = IsZero(given.up) ? EstimateUp(mesh) : ToVec(given.up);
  if (!IsZero(given.view_direction)) {
    options->view_direction = ToVec(given.view_direction);
    return Status::Ok();
  }
  const std::string_view view = given.view == nullptr ? "auto" : given.view;
  if (std::find(std::begin(kViewNames), std::end(kViewNames), view) == std::end(kViewNames)) {
    return InvalidArgument("options.view: there is no view \"" + std::string(view) + "\"");
  }
  options->view_direction = ViewDirection(view, options->up, mesh.positions);
  return Status::Ok();
}

// What the picture shows, and how large it is. `reference` has the mesh that options name.
Result<RenderOptions> StyleOf(const mtdb_render_options& given, const TriangleMesh& reference) {
  RenderOptions options;
  if (given.width > kMostPixels || given.height > kMostPixels) {
    return InvalidArgument("options: a picture has at most 16384 x 16384 pixels");
  }
  if (given.width != 0) options.width = static_cast<int>(given.width);
  if (given.height != 0) options.height = static_cast<int>(given.height);
  options.wireframe = given.wireframe != 0;
  options.smooth = given.smooth != 0;
  options.hillshade = given.hillshade != 0;
  options.draft = given.draft != 0;
  if (given.height_scale != 0) {
    if (!(given.height_scale > 0) || !std::isfinite(given.height_scale)) {
      return InvalidArgument("options.height_scale: expected a number above 0");
    }
    options.height_scale = given.height_scale;
  }
  if (given.height_units != nullptr) options.height_units = given.height_units;
  const int colour = given.colour;
  if (colour < MTDB_COLOUR_VERTEX || colour > MTDB_COLOUR_HEIGHT) {
    return InvalidArgument("options.colour: is no mtdb_colour");
  }
  options.colour = static_cast<ColourBy>(colour);
  if (options.colour == ColourBy::kAttribute) {
    if (given.attribute == nullptr) return InvalidArgument("options.attribute: is NULL");
    options.attribute = given.attribute;
  }
  if (options.colour == ColourBy::kDistance) options.reference = &reference;
  if (given.has_range != 0) options.range = {given.range[0], given.range[1]};
  options.legend = given.no_legend == 0;
  options.scale_bar = given.scale_bar != 0;
  if (given.has_background != 0) {
    options.background = {given.background[0], given.background[1], given.background[2]};
  }
  options.transparent = given.transparent != 0;
  return options;
}

static_assert(static_cast<int>(ColourBy::kOwn) == MTDB_COLOUR_VERTEX &&
              static_cast<int>(ColourBy::kNothing) == MTDB_COLOUR_NONE &&
              static_cast<int>(ColourBy::kNormal) == MTDB_COLOUR_NORMAL &&
              static_cast<int>(ColourBy::kAttribute) == MTDB_COLOUR_ATTRIBUTE &&
              static_cast<int>(ColourBy::kDistance) == MTDB_COLOUR_DISTANCE &&
              static_cast<int>(ColourBy::kHeight) == MTDB_COLOUR_HEIGHT);

// The image as pixels of 3 bytes, or of 4 where it has alpha.
void CopyPixels(const RenderImage& image, bool alpha, unsigned char* pixels) {
  const size_t count =
      size_t{1} * static_cast<size_t>(image.width) * static_cast<size_t>(image.height);
  if (!alpha) {
    std::memcpy(pixels, image.rgb.data(), 3 * count);
    return;
  }
  for (size_t i = 0; i < count; ++i) {
    std::copy_n(&image.rgb[3 * i], 3, pixels + 4 * i);
    pixels[4 * i + 3] = image.alpha.empty() ? uint8_t{255} : image.alpha[i];
  }
}

}  // namespace
}  // namespace mtdb::internal

using mtdb::Result;
using mtdb::Status;
using mtdb::internal::Guarded;
using mtdb::internal::NeedAll;
using mtdb::internal::Take;

mtdb_code mtdb_render(const mtdb_mesh* mesh, const mtdb_render_options* options,
                      unsigned char* pixels, size_t pixel_bytes, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{mesh, "mesh"}, {pixels, "pixels"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_render_options given, Take(options, "options"));
    mtdb::TriangleMesh reference;
    if (given.colour == MTDB_COLOUR_DISTANCE) {
      MTDB_RETURN_IF_ERROR(NeedAll({{given.reference, "options.reference"}}));
      MTDB_ASSIGN_OR_RETURN(reference, mtdb::internal::ToTriangleMesh(*given.reference));
    }
    MTDB_ASSIGN_OR_RETURN(mtdb::RenderOptions with, mtdb::internal::StyleOf(given, reference));
    const size_t needed = size_t{with.transparent ? 4u : 3u} * static_cast<size_t>(with.width) *
                          static_cast<size_t>(with.height);
    if (pixel_bytes < needed) {
      return mtdb::Status(mtdb::StatusCode::kBudgetExceeded,
                          "pixels: has room for " + std::to_string(pixel_bytes) +
                              " bytes, but the picture has " + std::to_string(needed));
    }
    MTDB_ASSIGN_OR_RETURN(const mtdb::TriangleMesh drawn, mtdb::internal::ToTriangleMesh(*mesh));
    MTDB_RETURN_IF_ERROR(mtdb::internal::SetView(given, drawn, &with));
    mtdb::RenderImage image;
    MTDB_RETURN_IF_ERROR(mtdb::RenderMesh(drawn, with, &image));
    mtdb::internal::CopyPixels(image, with.transparent, pixels);
    return Status::Ok();
  });
}

mtdb_code mtdb_write_png(const char* path, const unsigned char* pixels, uint32_t width,
                         uint32_t height, uint32_t channels, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{path, "path"}, {pixels, "pixels"}}));
    if (width == 0 || height == 0 || width > mtdb::internal::kMostPixels ||
        height > mtdb::internal::kMostPixels) {
      return mtdb::InvalidArgument("width, height: expected 1 to 16384");
    }
    if (channels != 3 && channels != 4) {
      return mtdb::InvalidArgument("channels: expected 3 or 4");
    }
    const size_t count = size_t{width} * height;
    mtdb::RenderImage image;
    image.width = static_cast<int>(width);
    image.height = static_cast<int>(height);
    if (channels == 3) {
      image.rgb.assign(pixels, pixels + 3 * count);
    } else {
      image.rgb.resize(3 * count);
      image.alpha.resize(count);
      for (size_t i = 0; i < count; ++i) {
        std::copy_n(pixels + 4 * i, 3, &image.rgb[3 * i]);
        image.alpha[i] = pixels[4 * i + 3];
      }
    }
    return mtdb::WritePng(path, image);
  });
}

mtdb_code mtdb_serve(const char* path, const mtdb_serve_options* options, mtdb_server** server,
                     mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{path, "path"}, {server, "server"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_serve_options given, Take(options, "options"));
    if (given.port > 65535) return mtdb::InvalidArgument("options.port: is above 65535");
    if (given.threads > mtdb::internal::kMostThreads) {
      return mtdb::InvalidArgument("options.threads: more than 1024");
    }
    mtdb::ServerOptions with;
    with.service.store = path;
    mtdb::internal::SetCache(given.cache_directory, given.cache_directory_bytes,
                             &with.service.open);
    with.listen.address = given.address == nullptr ? "127.0.0.1" : given.address;
    with.listen.port = static_cast<uint16_t>(given.port);
    with.threads = given.threads;
    if (given.cache_bytes != 0) with.service.cache_bytes = given.cache_bytes;
    if (given.max_triangles != 0) with.service.max_triangles = given.max_triangles;
    if (given.allowed_origin != nullptr) with.allowed_origin = given.allowed_origin;
    auto made = std::make_unique<mtdb_server>();
    MTDB_ASSIGN_OR_RETURN(made->server, mtdb::BackgroundServer::Start(with));
    *server = made.release();
    return Status::Ok();
  });
}

const char* mtdb_get_server_url(const mtdb_server* server) {
  return server == nullptr ? nullptr : server->server->url().c_str();
}

mtdb_code mtdb_stop_server(mtdb_server* server, double grace_seconds, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{server, "server"}}));
    if (!(grace_seconds >= 0)) return mtdb::InvalidArgument("grace_seconds: negative or NaN");
    return server->server->Stop(grace_seconds);
  });
}

void mtdb_free_server(mtdb_server* server) { delete server; }
