// SPDX-License-Identifier: Apache-2.0
// TileMaker: makes the tiles of a texture out of the image files of its pages.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "builder/disk/spool.h"
#include "codecs/image_file/image_rows.h"
#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/texture_tiles.h"
#include "store/tiles_head.h"

namespace mtdb::internal {

// Reads each image once, row by row, and makes all its levels on the way. The tiles wait in
// temporary files. Memory: 512 rows of each level, 3 or 4 KB a column of a page; up to 208 MiB
// of images that are not in rows. The tiles are the same whatever the number of threads.
class TileMaker {
 public:
  // Asked after each row of tiles; an error ends the page.
  using Check = std::function<Status()>;

  TileMaker(const SpoolSpace* space, unsigned threads, Check check)
      : space_(space), threads_(threads), check_(std::move(check)) {}

  // The next page, from its image file. Errors: kBadInput and kUnsupported when the image cannot be
  // read: the page then has no tiles, and the next one can be added; those of the spools and of
  // `check`, after which the tiles are of no use.
  Status AddPage(ByteSpan image);
  // The next page has no image.
  void AddEmptyPage() { pages_.emplace_back(); }

  // Hands out the file of the tiles from its beginning to its end; nothing when no page has any.
  using Append = std::function<Status(ByteSpan)>;
  Status Write(const Append& append);

 private:
  struct Tile {
    uint64_t offset = 0;  // in the level's spool
    TileEntry entry;
  };
  struct Level {
    std::vector<Tile> tiles;
    Spool bytes;
    explicit Level(const SpoolSpace* space) : bytes(space, 0) {}
  };
  class PageLevel;

  Level& LevelOf(uint32_t level);
  // Cuts the tiles of a row, which the level has, and puts them behind the level's.
  Status PutTiles(const PageLevel& level);
  Status PushRow(std::vector<PageLevel>& levels);
  Status ReadPage(ImageRows& rows);
  Status WriteLevel(uint32_t level, const Append& append);

  const SpoolSpace* const space_;
  const unsigned threads_;
  const Check check_;
  std::vector<TiledPage> pages_;
  std::vector<Level> levels_;
};

}  // namespace mtdb::internal
