// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "tools/cli/diff/comparison.h"
#include "tools/cli/diff/height_report.h"
#include "tools/cli/options.h"
#include "tools/cli/verbs.h"

namespace mtdb {
namespace {

void AddGoals(VerbOptions* verb, DiffArguments* a) {
  AddParsed(verb, "--tolerance", "T", &a->request.tolerance, ParseError,
            "is each point within T of the other object, in model units, or T% of A's diagonal? "
            "Every place is decided");
  AddParsed(verb, "--width", "W", &a->request.width, ParseError,
            "know the largest distance to within W (default without --tolerance: 0.01%)");
  AddParsed(verb, "--reach", "R", &a->request.reach, ParseError,
            "what is farther away than R is missing, and how far is not looked for");
  AddParsed(verb, "--max-milliseconds", "MS", &a->request.max_milliseconds, ParseNonNegative,
            "tell what was proved in MS milliseconds");
  AddParsed(verb, "--max-places", "N", &a->request.max_places, ParseCount,
            "tell at most N places each way: more are joined with those nearest to them")
      .Default("32768");
  verb->Add("--asks", a->request.asks, "whose points ask for the other object: a, b or both")
      .Form("WHOSE")
      .OneOf({"a", "b", "both"})
      .Default("both");
  AddParsed(verb, "--transform", "M", &a->request.transform, ParseTransform,
            "map B into A's coordinates by a 4x4 matrix, given row by row");
  AddHeights(verb, a);
  verb->AddFlag("--as-stored", a->request.as_stored,
                "compare what is stored, not the inputs that were rounded when they were stored");
}

RunVerb AddDiff(VerbOptions* verb) {
  const auto a = std::make_shared<DiffArguments>();
  verb->Add("A", a->a.store, "a store or packed file, or the URL of one").Required();
  verb->Add("B", a->b.store, "likewise; may be the same").Required();
  AddName(verb, &a->a.name);
  verb->Add("--other", a->b.name, "which object of B; needed when there are several").Form("NAME");
  AddGoals(verb, a.get());
  AddRegionsAlone(verb, &a->region, "Which points ask (several: in any of them)");
  verb->Add("--csv", a->files.csv, "write the places that exceed the tolerance, or may, a row each")
      .Form("FILE");
  verb->Add("--places-query", a->files.places_query,
            "write a query for the boxes of the places, for extract --query; nothing without any")
      .Form("FILE");
  verb->Add("--geojson", a->files.geojson,
            "write a polygon for each place, for QGIS; docs/guide.md says in which coordinates")
      .Form("FILE");
  verb->Add("--into", a->files.into,
            "store A at full resolution in STORE as NAME, with the attributes distance_low and "
            "distance_high: between them is each vertex' distance from B")
      .Form("STORE NAME")
      .Values(2, 2);
  verb->Add("--threads", a->threads, "use N threads (default: one per core)")
      .Form("N")
      .Between(1, 1024);
  AddCache(verb, &a->a.cache_bytes, kQuarterOfMemory);
  AddCacheDirectory(verb, &a->a.open);
  AddJson(verb, &a->json);
  AddVerbose(verb, &a->verbose);
  verb->CheckAll([a]() -> Status {
    a->b.cache_bytes = a->a.cache_bytes;
    a->b.open = a->a.open;
    MTDB_RETURN_IF_ERROR(CheckOptions(a->region, false));
    return CheckHeights(*a);
  });
  return [a](Invocation& invocation) {
    return a->request.heights ? DiffHeights(*a, invocation) : Diff(*a, invocation);
  };
}

}  // namespace

const Verb kDiffVerb{
    "diff", "prove how far two objects are apart, and where",
    "Examples: mtdb diff before.mtdb after.mtdb --tolerance 0.002\n"
    "          mtdb diff scan.mtdb design.mtdb --width 0.1% --asks a --json\n"
    "          mtdb diff may.mtdb june.mtdb --heights --width 0.01\n"
    "Exit status: 0 within the tolerance, or none was asked for; 1 error; 2 wrong usage;\n"
    "             3 exceeds the tolerance; 4 undecided.",
    AddDiff};

}  // namespace mtdb
