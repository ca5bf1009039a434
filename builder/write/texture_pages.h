// SPDX-License-Identifier: Apache-2.0
// The image files of a textured mesh become files of the object.
#pragma once

#include <string>
#include <vector>

#include "builder/write/texture_tiles.h"
#include "store/base/status.h"
#include "store/base/texture.h"
#include "store/object_record.h"
#include "store/object_writer.h"

namespace mtdb::internal {

// Loads the file of each page once, adds it to the object that `writer` writes, likewise the tiles
// that `tiles`, a new one, makes of them all, and makes `texture` say what they are. Names become
// such as a folder can hold, none twice. A page without a `load`, or whose load fails, is kept
// without bytes; `notes` gets a line that says why for each that fails, and for each of which no
// tiles can be made. Takes the memory of the largest file. Errors: kBadInput (too many pages),
// kCancelled and kNoSpace of a load, those of
// `writer` and of `tiles`.
Status AddTexturePages(const std::vector<Texture>& textures, ObjectWriter& writer, TileMaker& tiles,
                       TextureRecord* texture, std::vector<std::string>* notes);

}  // namespace mtdb::internal
