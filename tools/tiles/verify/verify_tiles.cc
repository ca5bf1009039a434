// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/verify/verify_tiles.h"

#include <memory>
#include <string>
#include <utility>

#include "store/base/out_of_memory.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/tile_folder.h"
#include "tools/tiles/verify/tile_files.h"
#include "tools/tiles/verify/tile_judge.h"
#include "tools/tiles/verify/verifiers.h"

namespace mtdb {

namespace {

// Empty where the record is damaged.
Json::Array RecordedLevels(const Json& record) {
  const Json& progress = record["progress"];
  const Json none;
  const Json& levels = progress.is_object() ? progress["levels"] : none;
  return levels.is_array() ? levels.elements() : Json::Array();
}

void CompareCount(const Json& record, TileJudge* judge) {
  uint64_t recorded = 0;
  for (const Json& level : RecordedLevels(record)) {
    if (const uint64_t* const tiles = level["tiles"].whole_number()) recorded += *tiles;
  }
  if (recorded == judge->tiles()) return;
  judge->Fail(kTileRecord, "has " + std::to_string(recorded) +
                               " tiles written, but the tree names " +
                               std::to_string(judge->tiles()));
}

Status Dispatch(const std::string& path, const TileFiles& files, const Json& of, TileJudge* judge) {
  if (of["format"] == Json("neuroglancer")) return VerifyNeuroglancer(path, of, judge);
  if (of["format"] == Json("quantized-mesh")) return VerifyQuantizedMesh(files, judge);
  if (of["format"] == Json("terrain-rgb")) return VerifyTerrainRgb(files, judge);
  return VerifyThreeDTiles(files, judge);
}

Status Verify(const Surface& surface, const std::string& path, const TileFiles& files,
              const Json& record, CheckReport* report) {
  const Json& of = record["of"];
  TileJudge judge(surface, report);
  const bool has_several = of.is_object() && of.contains("objects");
  if (!has_several && of["digest"] != Json(surface.record().digest_hex())) {
    judge.Fail(kTileRecord, "the tiles are of another version of the object; write them anew");
    return Status::Ok();
  }
  report->checks.push_back("tiles are of this version of " + surface.record().name);
  try {
    MTDB_RETURN_IF_ERROR(Dispatch(path, files, of, &judge));
    // Of several objects the record has the sum.
    if (!has_several || of["objects"].size() == 1) CompareCount(record, &judge);
  } catch (const UnexpectedJson& error) {
    judge.Fail("a file of JSON", error.what());
  }
  judge.Conclude("are there, lie in their boxes, and have falling errors");
  return Status::Ok();
}

}  // namespace

Status VerifyTiles(const Surface& surface, const std::string& path, CheckReport* report) {
  return CatchOutOfMemory([&]() -> Status {
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<TileFiles> files, OpenTileFiles(path));
    const Result<std::string> text = files->Read(kTileRecord);
    const Json record = text.ok() ? Json::ParseObject(*text) : Json();
    if (!record.is_object() || !IsTileRecord(record)) {
      return NotFound(path + ": no tiles by mtdb are there");
    }
    return Verify(surface, path, *files, record, report);
  });
}

}  // namespace mtdb
