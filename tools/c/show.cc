// SPDX-License-Identifier: Apache-2.0
// Pictures, and servers in threads of their own, from C.
#include <string>

#include "tools/c/internal/handles.h"
#include "tools/c/internal/mesh.h"
#include "tools/c/internal/watch.h"
#include "tools/c/mtdb_show.h"
#include "tools/render/render.h"
#include "tools/server/server.h"

// NOLINTNEXTLINE(readability-identifier-naming)
struct mtdb_server {
  std::unique_ptr<mtdb::BackgroundServer> server;
};

namespace mtdb::internal {

namespace {

constexpr uint32_t kMostPixels = 16384;

bool IsZero(const double v[3]) { return v[0] == 0 && v[1] == 0 && v[2] == 0; }

Result<RenderOptions> OptionsOf(const mtdb_render_options& given) {
  RenderOptions options;
  if (given.width > kMostPixels || given.height > kMostPixels) {
    return InvalidArgument("options: a picture has at most 16384 x 16384 pixels");
  }
  if (given.width != 0) options.width = static_cast<int>(given.width);
  if (given.height != 0) options.height = static_cast<int>(given.height);
  options.wireframe = given.wireframe != 0;
  for (const double* v : {given.frame_min, given.frame_max, given.view_direction, given.eye,
                          given.target, given.up}) {
    MTDB_RETURN_IF_ERROR(NeedFinite(ToVec(v), "options"));
  }
  if (given.has_frame != 0) {
    const Box3d frame{ToVec(given.frame_min), ToVec(given.frame_max)};
    if (frame.empty()) return InvalidArgument("options.frame_min: exceeds frame_max");
    options.frame = CornersOf(frame);
  }
  if (!IsZero(given.view_direction)) options.view_direction = ToVec(given.view_direction);
  if (given.has_camera != 0) {
    Camera camera;
    camera.eye = ToVec(given.eye);
    camera.direction = ToVec(given.target) - camera.eye;
    if (!IsZero(given.up)) camera.up = ToVec(given.up);
    if (given.vertical_fov_rad != 0) camera.vertical_fov_rad = given.vertical_fov_rad;
    camera.width_px = options.width;
    camera.height_px = options.height;
    MTDB_RETURN_IF_ERROR(camera.Validate());
    options.camera = camera;
  }
  return options;
}

}  // namespace
}  // namespace mtdb::internal

using mtdb::Result;
using mtdb::Status;
using mtdb::internal::Guarded;
using mtdb::internal::NeedAll;
using mtdb::internal::Take;

mtdb_code mtdb_render(const mtdb_mesh* mesh, const mtdb_render_options* options, unsigned char* rgb,
                      size_t rgb_bytes, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{mesh, "mesh"}, {rgb, "rgb"}}));
    MTDB_ASSIGN_OR_RETURN(const mtdb_render_options given, Take(options, "options"));
    MTDB_ASSIGN_OR_RETURN(const mtdb::RenderOptions with, mtdb::internal::OptionsOf(given));
    const size_t needed = size_t{3} * static_cast<size_t>(with.width * with.height);
    if (rgb_bytes < needed) {
      return mtdb::Status(mtdb::StatusCode::kBudgetExceeded,
                          "rgb: has room for " + std::to_string(rgb_bytes) +
                              " bytes, but the picture has " + std::to_string(needed));
    }
    MTDB_ASSIGN_OR_RETURN(const mtdb::TriangleMesh drawn, mtdb::internal::ToTriangleMesh(*mesh));
    mtdb::RenderImage image;
    MTDB_RETURN_IF_ERROR(mtdb::RenderMesh(drawn, with, &image));
    std::memcpy(rgb, image.rgb.data(), needed);
    return Status::Ok();
  });
}

mtdb_code mtdb_write_png(const char* path, const unsigned char* rgb, uint32_t width,
                         uint32_t height, mtdb_error* error) {
  return Guarded(error, [&]() -> Status {
    MTDB_RETURN_IF_ERROR(NeedAll({{path, "path"}, {rgb, "rgb"}}));
    if (width == 0 || height == 0 || width > mtdb::internal::kMostPixels ||
        height > mtdb::internal::kMostPixels) {
      return mtdb::InvalidArgument("width, height: expected 1 to 16384");
    }
    mtdb::RenderImage image;
    image.width = static_cast<int>(width);
    image.height = static_cast<int>(height);
    image.rgb.assign(rgb, rgb + size_t{3} * width * height);
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

const char* mtdb_server_url(const mtdb_server* server) {
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
