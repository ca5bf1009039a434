// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/mesh_report.h"

#include <array>
#include <cmath>
#include <cstdio>

#include "query/heights.h"
#include "store/metres_of_unit.h"
#include "tools/cli/grouped.h"
#include "tools/cli/raster_text.h"
#include "tools/client/printable.h"
#include "tools/request/report_json.h"
#include "tools/request/root_reason.h"

namespace mtdb {

namespace {

constexpr uint64_t kJournalBytes = 15;  // a triangle, see BuildOptions::journal_path

bool IsTooCoarse(const MeshSurvey& s) {
  constexpr double kStepsPerEdge = 4;
  return s.grid.step > s.edges.percentile1 / kStepsPerEdge;
}

const char* ReasonText(const MeshSurvey& s) {
  switch (s.reason) {
    case GridReason::kGiven: return "as the options say";
    case GridReason::kLeastBits: return "fine enough for the mesh's edges";
    case GridReason::kEdges:
      return IsTooCoarse(s) ? "as fine as they get; a quarter of the mesh's short edges is less"
                            : "a quarter of the mesh's short edges";
    case GridReason::kSlivers: return "so that thin triangles keep their area";
    case GridReason::kDecimals: return "so that coordinates stay as they are written";
    case GridReason::kSomeDecimals: return "so that those of some axes stay as they are written";
  }
  return "";
}

const char* ReasonName(GridReason reason) {
  switch (reason) {
    case GridReason::kGiven: return "given";
    case GridReason::kLeastBits: return "least_bits";
    case GridReason::kEdges: return "edges";
    case GridReason::kSlivers: return "slivers";
    case GridReason::kDecimals: return "decimals";
    case GridReason::kSomeDecimals: return "some_decimals";
  }
  return "";
}

double Megabytes(uint64_t bytes) { return static_cast<double>(bytes) / 1e6; }

// The raster that the object was, as it came.
void PrintRaster(const ObjectRecord& r) {
  const RasterFrame& f = *r.raster;
  std::printf("  raster       %s\n", RasterSizeText(f).c_str());
  std::printf("  samples      %s\n", SamplePlacesText(f).c_str());
  const std::string units = f.height_units.empty() ? "" : " " + Printable(f.height_units);
  std::printf("  heights      %.9g to %.9g%s, in steps of %.9g", r.bounds.min.z, r.bounds.max.z,
              units.c_str(), r.grid.step);
  if (!f.vertical_datum.empty()) std::printf(", datum %s", Printable(f.vertical_datum).c_str());
  if (f.nodata) std::printf(", nodata was %.9g", *f.nodata);
  std::printf(", rounded by up to %.6g\n", r.rounding_error);
  if (f.filled > 0)
    std::printf("  filled       %s samples that had no height\n", Grouped(f.filled).c_str());
  const std::array<double, 2> unit = MetresOfUnit(r);
  if (unit[1] != 1) {
    std::printf("  a degree     %.6g m along x, %.6g m along y, at the middle\n", unit[0], unit[1]);
  }
  std::printf("  crs          %s\n",
              r.georeference.empty() ? "not known" : Printable(r.georeference).c_str());
}

// The images that triangles' corners point into.
void PrintTexture(const TextureRecord& t) {
  uint64_t bytes = 0;
  for (const TextureRecord::Page& page : t.pages) bytes += page.bytes;
  std::printf("  texture      %s, %s bytes, and %s of tiles for drawing\n",
              Counted(t.pages.size(), "page", "pages").c_str(), Grouped(bytes).c_str(),
              Grouped(t.tiles.bytes).c_str());
  std::printf("  u and v      step %.6g, rounded by up to %.6g, 1 counts as %.6g\n", t.step,
              t.rounding, t.scale);
  constexpr size_t kMostShown = 16;
  for (size_t i = 0; i < t.pages.size() && i < kMostShown; ++i) {
    const TextureRecord::Page& page = t.pages[i];
    std::printf("  page         %s", Printable(page.name).c_str());
    if (!page.media_type.empty()) std::printf(", %s", Printable(page.media_type).c_str());
    if (page.width != 0) std::printf(", %u x %u pixels", page.width, page.height);
    std::printf("%s\n", page.bytes == 0 ? ", which the store has not"
                                        : (", " + Grouped(page.bytes) + " bytes").c_str());
  }
  if (t.pages.size() > kMostShown) {
    std::printf("  page         and %zu more\n", t.pages.size() - kMostShown);
  }
}

// "y", "-z", or the numbers of another vector.
std::string UpText(Vec3d up) {
  for (int i = 0; i < 3; ++i) {
    if (std::fabs(up[i]) > 1 - 1e-9) return std::string(up[i] < 0 ? "-" : "") + "xyz"[i];
  }
  char text[100];
  std::snprintf(text, sizeof(text), "%.6g %.6g %.6g", up.x, up.y, up.z);
  return text;
}

}  // namespace

std::string AccuracyLine(const MeshSurvey& s) {
  if (s.grid.mode == PositionMode::kLossless) return "positions: float32, lossless";
  if (s.grid.mode == PositionMode::kRaster) {
    return Formatted("positions: columns and rows as they are, heights in steps of %.6g",
                     s.grid.step);
  }
  std::string line =
      Formatted("positions: %d bits, steps of %.6g, %s", s.bits, s.grid.step, ReasonText(s));
  constexpr int kUsualBits = 16;
  if (s.reason != GridReason::kGiven && s.bits > kUsualBits) {
    // Measured on scans: 2 to 3 bits a vertex for each bit, some 7 % of a store.
    line += Formatted("; the store is some %d %% larger than at %d bits", 7 * (s.bits - kUsualBits),
                      kUsualBits);
  }
  return line;
}

std::vector<std::string> AccuracyWarnings(const MeshSurvey& s) {
  std::vector<std::string> warnings;
  if (!s.refusal.ok()) return {"ingest refuses this: " + s.refusal.message()};
  if (s.far_vertices) {
    warnings.push_back(
        Formatted("half of the edges are shorter than %.3g, the steps of the grid are "
                  "%.3g: ",
                  s.edges.median, s.grid.step) +
        FarVerticesText(*s.far_vertices) + "; without, the grid would be finer");
  }
  if (s.attributes_differ) {
    warnings.push_back(
        Formatted("%s vertices lie where others do, with other attributes: the mesh is "
                  "cut there, and the cuts are never simplified; --weld would join them",
                  Grouped(s.equal_vertices).c_str()));
  }
  if (!s.oriented && s.sheets.turned_triangles != 0) {
    warnings.push_back(Formatted(
        "%s edges have two triangles that disagree about the outside; "
        "--orient turns %s triangles over, so that they agree",
        Grouped(s.sheets.inconsistent_edges).c_str(), Grouped(s.sheets.turned_triangles).c_str()));
  }
  if (s.collapsed_triangles != 0) {
    warnings.push_back(Formatted("%s of %s triangles are too thin for steps of %.3g and lose their "
                                 "area; ",
                                 Grouped(s.collapsed_triangles).c_str(),
                                 Grouped(s.kept_triangles).c_str(), s.grid.step) +
                       (s.advised_bits > s.bits ? Formatted("%d bits (steps of %.3g) suit the mesh",
                                                            s.advised_bits, s.advised_step)
                        : s.fits_float32        ? std::string("--lossless keeps them")
                                                : std::string("no grid is finer")));
  }
  return warnings;
}

void PrintSurvey(const std::string& name, const MeshSurvey& s) {
  std::printf("%s\n", Printable(name).c_str());
  std::printf("  mesh         %s, %s", Counted(s.triangles, "triangle", "triangles").c_str(),
              Counted(s.vertices, "vertex", "vertices").c_str());
  if (s.components) {
    std::printf(", %s\n", Counted(*s.components, "component", "components").c_str());
  } else {
    std::printf("; its components were not counted, which takes 4 bytes a vertex\n");
  }
  std::printf("  bounds       %.9g %.9g %.9g to %.9g %.9g %.9g, diagonal %.6g\n", s.bounds.min.x,
              s.bounds.min.y, s.bounds.min.z, s.bounds.max.x, s.bounds.max.y, s.bounds.max.z,
              Diagonal(s.bounds));
  if (s.edges.longest > 0) {
    std::printf("  edges        %.3g to %.3g long, half of them below %.3g, 1 %% below %.3g\n",
                s.edges.shortest, s.edges.longest, s.edges.median, s.edges.percentile1);
  }
  if (s.triangles != s.kept_triangles) {
    std::printf("  dropped      %s triangles with two equal vertices\n",
                Grouped(s.triangles - s.kept_triangles).c_str());
  }
  if (s.flat_triangles != 0) {
    std::printf("  flat         %s triangles without area\n", Grouped(s.flat_triangles).c_str());
  }
  if (s.oriented && s.sheets.turned_triangles != 0) {
    std::printf("  orientation  %s triangles are turned over\n",
                Grouped(s.sheets.turned_triangles).c_str());
  }
  if (s.sheets.unorientable_sheets != 0) {
    std::printf("  one-sided    %s, as a Moebius band; cannot be oriented\n",
                Counted(s.sheets.unorientable_sheets, "sheet", "sheets").c_str());
  }
  for (const VertexAttribute& a : s.header.attributes.attributes) {
    std::printf("  attribute    %s\n", Printable(a.name).c_str());
  }
  if (s.welded_vertices != 0) {
    std::printf("  welded       %s vertices became others\n", Grouped(s.welded_vertices).c_str());
  }
  if (s.equal_vertices != 0) {
    std::printf("  apart        %s vertices lie where others do; --weld would join them\n",
                Grouped(s.equal_vertices).c_str());
  }
  std::printf("  %s\n", AccuracyLine(s).c_str());
  if (s.collapsed_at_16_bits != 0) {
    std::printf("  at 16 bits %s triangles would lose their area\n",
                Grouped(s.collapsed_at_16_bits).c_str());
  }
  std::printf("  about %.3g MB in a store\n", Megabytes(s.store_bytes));
  if (s.temporary_bytes == 0) {
    std::printf("  no temporary files but the journal, of some %.3g MB\n",
                Megabytes(kJournalBytes * s.kept_triangles));
  } else {
    std::printf("  up to %.3g MB of temporary files, and a journal of some %.3g MB\n",
                Megabytes(s.temporary_bytes), Megabytes(kJournalBytes * s.kept_triangles));
  }
  for (const std::string& warning : AccuracyWarnings(s)) {
    std::printf("  warning: %s\n", warning.c_str());
  }
}

Json AccuracyJson(const MeshSurvey& s) {
  Json json{{"reason", ReasonName(s.reason)},
            {"collapsed_triangles", s.collapsed_triangles},
            {"collapsed_at_16_bits", s.collapsed_at_16_bits},
            {"flat_triangles", s.flat_triangles},
            {"advised_bits", s.advised_bits},
            {"advised_step", s.advised_step}};
  if (s.far_vertices) {
    Json& far = json["far_vertices"];
    far = {{"count", s.far_vertices->count}, {"position", Json(s.far_vertices->position)}};
    if (s.far_vertices->vertex) far["vertex"] = *s.far_vertices->vertex;
  }
  return json;
}

Json SurveyJson(const MeshSurvey& s) {
  Json attributes = Json::Array();
  for (const VertexAttribute& a : s.header.attributes.attributes) attributes.push_back(a.name);
  Json json{{"triangles", s.triangles},
            {"vertices", s.vertices},
            {"degenerate_triangles", s.triangles - s.kept_triangles},
            {"welded_vertices", s.welded_vertices},
            {"equal_vertices", s.equal_vertices},
            {"inconsistent_edges", s.sheets.inconsistent_edges},
            {"turned_triangles", s.sheets.turned_triangles},
            {"unorientable_sheets", s.sheets.unorientable_sheets},
            {"bounds", {{"min", Json(s.bounds.min)}, {"max", Json(s.bounds.max)}}},
            {"diagonal", Diagonal(s.bounds)},
            {"edges",
             {{"shortest", s.edges.shortest},
              {"percentile_1", s.edges.percentile1},
              {"median", s.edges.median},
              {"longest", s.edges.longest}}},
            {"attributes", attributes},
            {"bits", s.bits},
            {"step", s.grid.mode == PositionMode::kLossless ? 0.0 : s.grid.step},
            {"accuracy", AccuracyJson(s)},
            {"store_bytes", s.store_bytes},
            {"temporary_bytes", s.temporary_bytes},
            {"journal_bytes", kJournalBytes * s.kept_triangles},
            {"warnings", AccuracyWarnings(s)}};
  if (s.components) json["components"] = *s.components;
  if (!s.refusal.ok()) json["refused"] = s.refusal.message();
  return json;
}

void PrintStages(const BuildReport& report, const ObjectRecord& r) {
  for (size_t i = 0; i < r.rounds.size(); ++i) {
    const RoundReport& round = r.rounds[i];
    std::printf(
        "  round %zu: %s triangles become %s, in %s tiles and %s clusters, with an error "
        "of at "
        "most %.3g; vertices that had to stay: %s by topology, %s by degree, %s on seams of "
        "tiles\n",
        i + 1, Grouped(round.triangles_in).c_str(), Grouped(round.triangles_out).c_str(),
        Grouped(round.tiles).c_str(), Grouped(round.clusters).c_str(),
        r.grid.Error(round.error_code_max), Grouped(round.stuck_topology).c_str(),
        Grouped(round.stuck_degree).c_str(), Grouped(round.locked_vertices).c_str());
  }
  std::printf("  %u clusters of %s vertices to insert; the coarsest mesh has %s triangles\n",
              r.clusters, Grouped(r.nodes).c_str(), Grouped(r.root_triangles).c_str());
  std::printf("  %s\n", RootReasonText(r).c_str());
  double cpu = 0;
  for (const StageCost& s : report.stages) {
    std::printf("  %-9s %8.2f s, %8.2f s of processors, %s MiB temporary\n", s.stage.c_str(),
                s.seconds, s.cpu_seconds, Grouped(s.tmp_bytes >> 20).c_str());
    cpu += s.cpu_seconds;
  }
  if (cpu > 0) {
    std::printf("  %.3f million triangles per processor second\n",
                1e-6 * static_cast<double>(r.triangles) / cpu);
  }
}

void PrintInfo(const ObjectRecord& r) {
  std::printf("%s\n", r.name.c_str());
  std::printf("  surface      %s\n", SurfaceText(r).c_str());
  std::printf("  bounds       %.9g %.9g %.9g to %.9g %.9g %.9g, diagonal %.6g\n", r.bounds.min.x,
              r.bounds.min.y, r.bounds.min.z, r.bounds.max.x, r.bounds.max.y, r.bounds.max.z,
              r.diagonal());
  if (!r.units.empty()) std::printf("  units        %s\n", Printable(r.units).c_str());
  if (r.up) {
    std::printf("  up           %s%s\n", UpText(r.up->direction).c_str(),
                r.up->given    ? ", as ingest was told"
                : IsTerrain(r) ? ""
                               : ", found from the shape");
  }
  if (r.raster) {
    PrintRaster(r);
  } else if (r.grid.mode == PositionMode::kLossless) {
    std::printf("  positions    float32, lossless\n");
  } else {
    std::printf("  positions    %d bits, step %.6g, rounded by up to %.6g\n", r.bits, r.grid.step,
                r.rounding_error);
  }
  if (r.error_measure == ErrorMeasure::kVertical) {
    std::printf("  errors       vertical: differences in height\n");
  }
  for (const VertexAttribute& a : r.attributes.attributes) {
    std::printf("  attribute    %s", a.name.c_str());
    if (a.step > 0) std::printf(", step %.6g", a.step);
    if (a.normal_bits > 0) std::printf(" and the next two: a normal of 2 x %d bits", a.normal_bits);
    std::printf("\n");
  }
  if (r.texture) PrintTexture(*r.texture);
  std::printf("  MT           %s nodes in %u clusters, depth %u, degree up to %u, %zu rounds\n",
              Grouped(r.nodes).c_str(), r.clusters, r.depth, r.max_degree, r.rounds.size());
  std::printf("  root         %s triangles, error up to %.6g\n", Grouped(r.root_triangles).c_str(),
              r.grid.Error(r.error_code_max));
  std::printf("               %s\n", RootReasonText(r).c_str());
  std::printf("  size         %s bytes, %.2f bits per vertex%s\n", Grouped(r.stored_bytes).c_str(),
              BitsPerVertex(r), r.texture ? " without the pages" : "");
  std::printf("  digest       %s\n", r.digest_hex().c_str());
}

}  // namespace mtdb
