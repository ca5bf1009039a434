// SPDX-License-Identifier: Apache-2.0
// Pictures of meshes with an image over them: each pixel has the image's colour at its place.
#include <functional>
#include <png.h>

#include "tests/codecs/image_file/image_testing.h"
#include "tests/tools/terrain_testing.h"
#include "tools/render/render.h"

namespace mtdb::test {
namespace {

struct Image {
  uint32_t width = 0, height = 0;
  std::vector<uint8_t> rgba;
  const uint8_t* At(uint32_t x, uint32_t y) const { return &rgba[4 * (y * width + x)]; }
};

using Colour = std::array<uint8_t, 4>;

Image Painted(uint32_t width, uint32_t height,
              const std::function<Colour(uint32_t x, uint32_t y)>& colour) {
  Image image{width, height, {}};
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const Colour c = colour(x, y);
      image.rgba.insert(image.rgba.end(), c.begin(), c.end());
    }
  }
  return image;
}

constexpr Colour kRed{220, 30, 30, 255}, kGreen{30, 200, 30, 255}, kBlue{40, 40, 230, 255},
    kYellow{220, 210, 20, 255};

// Red, green, blue and yellow quarters, row by row.
Image Quarters(uint32_t width, uint32_t height) {
  return Painted(width, height, [&](uint32_t x, uint32_t y) {
    const bool right = x >= width / 2, below = y >= height / 2;
    if (below) return right ? kYellow : kBlue;
    return right ? kGreen : kRed;
  });
}

std::string PngOf(const Image& image) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = image.width;
  png.height = image.height;
  png.format = PNG_FORMAT_RGBA;
  std::string bytes(PNG_IMAGE_PNG_SIZE_MAX(png), '\0');
  png_alloc_size_t size = bytes.size();
  REQUIRE(png_image_write_to_memory(&png, bytes.data(), &size, 0, image.rgba.data(), 0, nullptr) !=
          0);
  bytes.resize(size);
  return bytes;
}

// Of 16 bits a channel, each byte twice, and no word on what its numbers mean.
std::string DeepPngOf(const Image& image) {
  std::string bytes;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(
      png, &bytes,
      [](png_structp to, png_bytep data, size_t size) {
        static_cast<std::string*>(png_get_io_ptr(to))->append(data, data + size);
      },
      nullptr);
  png_set_IHDR(png, info, image.width, image.height, 16, PNG_COLOR_TYPE_RGBA, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  for (uint32_t y = 0; y < image.height; ++y) {
    std::vector<uint8_t> line;
    for (size_t i = 0; i < size_t{8} * image.width; ++i) line.push_back(image.At(0, y)[i / 2]);
    png_write_row(png, line.data());
  }
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  return bytes;
}

std::string JpegOf(const Image& image, bool grey = false) {
  const Bytes file = testing::JpegOf({image.width, image.height, 4, image.rgba}, 95, false, grey);
  return {reinterpret_cast<const char*>(file.data()), file.size()};
}

Image ReadPicture(const std::string& path) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  REQUIRE(png_image_begin_read_from_file(&png, path.c_str()) != 0);
  png.format = PNG_FORMAT_RGBA;
  Image image{png.width, png.height, std::vector<uint8_t>(size_t{4} * png.width * png.height)};
  REQUIRE(png_image_finish_read(&png, nullptr, image.rgba.data(), 0, nullptr) != 0);
  return image;
}

// Which of the four a shaded pixel is; 0: none of them.
char HueOf(const uint8_t* p) {
  const double r = p[0] + 1, g = p[1] + 1, b = p[2] + 1, more = 1.25;  // whatever the light
  if (r > more * b && g > more * b) return 'y';
  if (r > more * g && r > more * b) return 'r';
  if (g > more * r && g > more * b) return 'g';
  if (b > more * r && b > more * g) return 'b';
  return 0;
}

// A square of side 10, 20 triangles a side, level or with waves.
TriangleMesh Square(double waves) {
  TriangleMesh mesh;
  constexpr uint64_t kSide = 20;
  for (uint64_t y = 0; y <= kSide; ++y) {
    for (uint64_t x = 0; x <= kSide; ++x) {
      const auto px = static_cast<double>(x), py = static_cast<double>(y);
      mesh.positions.push_back({1000 + px / 2, 5e6 + py / 2, waves * std::sin(px) * std::sin(py)});
    }
  }
  for (uint64_t y = 0; y < kSide; ++y) {
    for (uint64_t x = 0; x < kSide; ++x) {
      const uint64_t a = y * (kSide + 1) + x, b = a + 1, c = a + kSide + 1, d = c + 1;
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({b, d, c});
    }
  }
  return mesh;
}

// Pixel (column, row) has its corner at `corner` + column * `right` + row * `down`.
MeshTexture Placed(std::string file, const Image& image, Vec3d corner, Vec3d right, Vec3d down) {
  MeshTexture texture;
  texture.image = std::move(file);
  const double area = right.x * down.y - down.x * right.y;
  const double w = area * image.width, h = area * image.height;
  texture.place = {(corner.y * down.x - corner.x * down.y) / w,   down.y / w,   -down.x / w,
                   (corner.x * right.y - corner.y * right.x) / h, -right.y / h, right.x / h};
  return texture;
}

RenderOptions FromAbove() {
  RenderOptions options;
  options.width = options.height = 120;
  options.view_direction = {0, 0, -1};
  options.up = {0, 1, 0};
  options.view_angle_rad = 0.01;
  options.transparent = true;
  options.draft = true;
  return options;
}

RenderImage Draw(const TriangleMesh& mesh, const RenderOptions& options) {
  RenderImage image;
  const Status status = RenderMesh(mesh, options, &image);
  INFO(status.message());
  REQUIRE(status.ok());
  return image;
}

// Calls visit(x, y, pixel) with where the pixels of the square lie on it, from 0 to 1; no pixels
// near its sides.
template <typename Visit>
void ForEachPlace(const RenderImage& picture, Visit visit) {
  int least_x = picture.width, most_x = -1, least_y = picture.height, most_y = -1;
  const auto at = [&](int x, int y) {
    return static_cast<size_t>(y) * static_cast<size_t>(picture.width) + static_cast<size_t>(x);
  };
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      if (picture.alpha[at(x, y)] == 0) continue;
      least_x = std::min(least_x, x), most_x = std::max(most_x, x);
      least_y = std::min(least_y, y), most_y = std::max(most_y, y);
    }
  }
  REQUIRE(most_x - least_x > 80);
  for (int y = least_y + 2; y < most_y - 1; ++y) {
    for (int x = least_x + 2; x < most_x - 1; ++x) {
      visit((x + 0.5 - least_x) / (most_x + 1 - least_x),
            1 - (y + 0.5 - least_y) / (most_y + 1 - least_y), &picture.rgb[3 * at(x, y)]);
    }
  }
}

TEST_CASE("an image lies over a mesh where its place says", "[render]") {
  const bool jpeg = GENERATE(false, true);
  const double waves = GENERATE(0.0, 0.1);
  const Image image = Quarters(64, 48);
  const TriangleMesh mesh = Square(waves);
  RenderOptions options = FromAbove();
  // Turned, and over a part of the square.
  const Vec3d corner{1001.5, 5e6 + 8, 0}, right{6.0 / 64, 1.0 / 64, 0},
      down{1.0 / 48, -6.0 / 48, 0};
  const std::string file = jpeg ? JpegOf(image) : PngOf(image);
  options.drape = Placed(file, image, corner, right, down);
  size_t seen[5] = {};
  ForEachPlace(Draw(mesh, options), [&](double x, double y, const uint8_t* pixel) {
    const double dx = 1000 + 10 * x - corner.x, dy = 5e6 + 10 * y - corner.y;
    const double area = right.x * down.y - down.x * right.y;
    const double u = (dx * down.y - dy * down.x) / area / 64;
    const double v = (dy * right.x - dx * right.y) / area / 48;
    for (const double side : {0.0, 0.5, 1.0}) {
      if (std::abs(u - side) < 0.03 || std::abs(v - side) < 0.03) return;
    }
    const bool inside = u > 0 && u < 1 && v > 0 && v < 1;
    const char wanted = !inside ? '\0' : "rgby"[(v > 0.5 ? 2 : 0) + (u > 0.5 ? 1 : 0)];
    ++seen[!inside ? 4 : (v > 0.5 ? 2 : 0) + (u > 0.5 ? 1 : 0)];
    if (HueOf(pixel) != wanted) {
      INFO(u << " " << v << ": " << int{pixel[0]} << " " << int{pixel[1]} << " " << int{pixel[2]});
      CHECK(HueOf(pixel) == wanted);
    }
  });
  for (const size_t n : seen) CHECK(n > 300);
}

TEST_CASE("a PNG of 16 bits looks as that of 8 bits does", "[render]") {
  const TriangleMesh mesh = Square(0.1);
  const Image image = Quarters(64, 48);
  RenderOptions options = FromAbove();
  const auto draw = [&](const std::string& file) {
    options.drape = Placed(file, image, {1000, 5e6 + 10, 0}, {10.0 / 64, 0, 0}, {0, -10.0 / 48, 0});
    return Draw(mesh, options).rgb;
  };
  CHECK(draw(DeepPngOf(image)) == draw(PngOf(image)));
}

// A progressive JPEG, all grey, whose later scans add nothing, in few bytes each.
std::string ManyScans(size_t scans) {
  constexpr char kHead[] =
      "\xff\xd8\xff\xc2\x00\x0b\x08\x00\x40\x00\x40\x01\x01\x11\x00\xff\xdb\x00\x43\x00";
  const std::string steps(64, '\1'), lengths = '\1' + std::string(15, '\0');
  std::string file(kHead, sizeof(kHead) - 1);
  // Tables of one code each, 0: a DC difference of 0; up to 127 blocks that end at once.
  file += steps + std::string("\xff\xc4\x00\x14\x00", 5) + lengths + '\0';
  file += std::string("\xff\xc4\x00\x14\x10", 5) + lengths + '\x60';
  file += std::string("\xff\xda\x00\x08\x01\x01\x00\x00\x00\x00", 10) + std::string(8, '\0');
  for (size_t i = 1; i < scans; ++i) {
    // 64 blocks: code 0, then six bits of 0.
    file += std::string("\xff\xda\x00\x08\x01\x01\x00\x01\x3f\x00\x01", 11);
  }
  return file + "\xff\xd9";
}

TEST_CASE("a JPEG may have many scans, but not without end", "[render]") {
  RenderOptions options = FromAbove();
  const Image image{64, 64, {}};
  RenderImage picture;
  const auto draw = [&](size_t scans) {
    options.drape =
        Placed(ManyScans(scans), image, {1000, 5e6 + 10, 0}, {10.0 / 64, 0, 0}, {0, -10.0 / 64, 0});
    return RenderMesh(Square(0), options, &picture);
  };
  const Status status = draw(90);
  INFO(status.message());
  CHECK(status.ok());
  CHECK(draw(110).code() == StatusCode::kBadInput);
  CHECK_THAT(draw(110).message(), Catch::Contains("more than 100 scans"));
}

TEST_CASE("what an image leaves free is as without it", "[render]") {
  const TriangleMesh mesh = Square(0.1);
  RenderOptions options = FromAbove();
  options.draft = false;
  options.colour = GENERATE(ColourBy::kNothing, ColourBy::kHeight);
  options.legend = false;
  const RenderImage without = Draw(mesh, options);
  const Image clear = Painted(8, 8, [](uint32_t, uint32_t) { return Colour{255, 0, 0, 0}; });
  options.drape = Placed(PngOf(clear), clear, {1000, 5e6 + 10, 0}, {1.25, 0, 0}, {0, -1.25, 0});
  CHECK(Draw(mesh, options).rgb == without.rgb);
  const Image red = Painted(8, 8, [](uint32_t, uint32_t) { return kRed; });
  options.drape = Placed(PngOf(red), red, {1100, 5e6 + 10, 0}, {1.25, 0, 0}, {0, -1.25, 0});
  CHECK(Draw(mesh, options).rgb == without.rgb);
  options.drape = Placed(PngOf(red), red, {1000, 5e6 + 10, 0}, {1.25, 0, 0}, {0, -1.25, 0});
  CHECK(Draw(mesh, options).rgb != without.rgb);
}

TEST_CASE("an image of finer pixels than the picture's is averaged", "[render]") {
  const TriangleMesh mesh = Square(0);
  RenderOptions options = FromAbove();
  const auto draw = [&](const Image& image) {
    const double pixel = 10.0 / image.width;
    options.drape = Placed(PngOf(image), image, {1000, 5e6 + 10, 0}, {pixel, 0, 0}, {0, -pixel, 0});
    return Draw(mesh, options);
  };
  const RenderImage board = draw(Painted(1600, 1600, [](uint32_t x, uint32_t y) {
    return (x + y) % 2 == 0 ? Colour{255, 255, 255, 255} : Colour{0, 0, 0, 255};
  }));
  // Half of white's light.
  const RenderImage grey = draw(Painted(8, 8, [](uint32_t, uint32_t) {
    return Colour{186, 186, 186, 255};
  }));
  for (size_t i = 0; i < board.rgb.size(); ++i) {
    if (std::abs(board.rgb[i] - grey.rgb[i]) > 2) {
      FAIL("pixel " << i / 3 << ": " << int{board.rgb[i]} << ", not " << int{grey.rgb[i]});
    }
  }
}

TEST_CASE("JPEG in grey, and files that are no images", "[render]") {
  const TriangleMesh mesh = Square(0);
  const Image image = Quarters(64, 48);
  RenderOptions options = FromAbove();
  const auto draw = [&](const std::string& file) {
    options.drape = Placed(file, image, {1000, 5e6 + 10, 0}, {10.0 / 64, 0, 0}, {0, -10.0 / 48, 0});
    RenderImage picture;
    return RenderMesh(mesh, options, &picture);
  };
  CHECK(draw(JpegOf(image, true)).ok());
  const std::string png = PngOf(image), jpeg = JpegOf(image);
  for (const std::string& file : {png, jpeg}) {
    for (size_t length = 0; length < file.size(); length += 1 + file.size() / 97) {
      INFO(length << " of " << file.size());
      // A file that lacks its last bytes may have all of its pixels.
      if (length + 24 > file.size()) break;
      CHECK(draw(file.substr(0, length)).code() == StatusCode::kBadInput);
    }
    // Flipped bits: an image or an error.
    for (size_t i = 0; i < file.size(); i += 3) {
      std::string damaged = file;
      damaged[i] = static_cast<char>(damaged[i] ^ (1 << i % 8));
      const Status status = draw(damaged);
      if (!status.ok() && status.code() != StatusCode::kUnsupported) {
        CHECK(status.code() == StatusCode::kBadInput);
      }
    }
  }
  std::string huge = jpeg;
  const size_t frame = huge.find("\xff\xc0");
  REQUIRE(frame != std::string::npos);
  huge.replace(frame + 5, 4, "\xff\xd0\xff\xd0");
  CHECK_THAT(draw(huge).message(), Catch::Contains("65488 x 65488"));
  for (const ColourBy by : {ColourBy::kNormal, ColourBy::kDistance}) {
    options.colour = by;
    options.reference = &mesh;
    CHECK(draw(png).code() == StatusCode::kInvalidArgument);
  }
}

// The hue of the picture's pixel that shows the quarter's middle, from above.
void CheckQuarters(const std::string& path) {
  const Image picture = ReadPicture(path);
  const Image& p = picture;
  const uint32_t w = p.width / 4, h = p.height / 4;
  INFO(int{p.At(w, h)[0]} << " " << int{p.At(w, h)[1]} << " " << int{p.At(w, h)[2]});
  CHECK(HueOf(p.At(w, h)) == 'r');
  CHECK(HueOf(p.At(3 * w, h)) == 'g');
  CHECK(HueOf(p.At(w, 3 * h)) == 'b');
  CHECK(HueOf(p.At(3 * w, 3 * h)) == 'y');
}

TEST_CASE("mtdb render drapes an image over terrains in metres and degrees", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb"), out = folder.File("out.png"),
                    image = folder.File("photo.png");
  WriteText(image, PngOf(Quarters(40, 20)));
  // Any number of bytes 0xff may come before a marker.
  WriteText(folder.File("photo.jpg"), JpegOf(Quarters(40, 20)).insert(2, 3, '\xff'));
  const bool degrees = GENERATE(false, true);
  if (degrees) {
    const Tile tile;
    RunOk({"copy", tile.store, store});
    WriteText(folder.File("photo.pgw"), "0.025\n0\n0\n-0.05\n7.0125\n9.975\n");
  } else {
    WriteGrid(folder.File("dem.asc"),
              "ncols 30\nnrows 30\nxllcenter 500000\nyllcenter 5100000\ncellsize 2\n", 30,
              MakeHeights(30, 30, 4));
    RunOk({"ingest", folder.File("dem.asc"), store});
    WriteText(folder.File("photo.pgw"), "1.45\n0\n0\n-2.9\n500000.725\n5100056.55\n");
  }
  std::filesystem::copy_file(folder.File("photo.pgw"), folder.File("photo.jgw"));
  for (const char* const name : {"photo.png", "photo.jpg"}) {
    for (const char* const more : {"--json", "--hillshade", "--smooth"}) {
      const Outcome outcome = Run({"render", store, out, "--drape", folder.File(name), "--size",
                                   "200x200", "--exaggerate", "1.5", more});
      INFO(outcome.err);
      REQUIRE(outcome.exit_code == 0);
      CheckQuarters(out);
      if (std::string(more) == "--json") {
        const Json picture = ParseJson(outcome.out).at("picture");
        CHECK(picture.at("image") == folder.File(name));
        // However steep it is.
        CHECK(picture.at("up") == Json::array({0, 0, 1}));
      }
    }
  }
  // In perspective, too, and with tints beneath.
  RunOk({"render", store, out, "--drape", image, "--view", "iso", "--colour", "height"});
  CHECK_THAT(Run({"render", store, out, "--drape", image, "--colour", "error"}).err,
             Catch::Contains("--drape: does not go with"));
  WriteText(image, PngOf(Quarters(40, 20)).substr(0, 90));
  const Outcome damaged = Run({"render", store, out, "--drape", image});
  CHECK(damaged.exit_code == 1);
  CHECK_THAT(damaged.err, Catch::Contains("photo.png: the PNG file is damaged"));
}

}  // namespace
}  // namespace mtdb::test
