// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <unistd.h>

#include "builder/build.h"
#include "builder/mesh_survey.h"
#include "codecs/mesh_file/mesh_file.h"
#include "codecs/raster_file/raster_file.h"
#include "store/object_name.h"
#include "tools/cli/grouped.h"
#include "tools/cli/machine.h"
#include "tools/cli/mesh_report.h"
#include "tools/cli/options.h"
#include "tools/cli/progress.h"
#include "tools/cli/raster_ingest.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/ingest_arguments.h"
#include "tools/cli/verbs/ingest_journal.h"
#include "tools/cli/verbs/late_writer.h"
#include "tools/cli/verbs/merge.h"
#include "tools/gdal/gdal_raster.h"
#include "tools/request/arguments.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

// Resident memory now, in bytes; 0 where the system does not tell.
uint64_t ResidentBytes() {
  uint64_t pages = 0;
  std::ifstream statm("/proc/self/statm");
  statm >> pages >> pages;
  return pages * static_cast<uint64_t>(sysconf(_SC_PAGE_SIZE));
}

// Says where the build is; `rate` is of the stage, in triangles a second.
std::string Describe(const BuildProgress& p, double rate) {
  std::string text = p.stage;
  if (p.round != 0) {
    text += " " + std::to_string(p.round) + ", " + std::to_string(p.triangles_done) + " of " +
            std::to_string(p.triangles_total) + " triangles";
  }
  if (rate > 0) text += ", " + std::to_string(static_cast<uint64_t>(rate / 1000)) + " k/s";
  text += "; " + std::to_string(ResidentBytes() >> 20) + " MiB memory, " +
          std::to_string(p.tmp_bytes >> 20) + " MiB temporary";
  return text;
}

// Set by Ctrl-C.
volatile std::sig_atomic_t g_interrupted = 0;

Status LookForInterrupt() {
  return g_interrupted == 0 ? Status::Ok() : Status(StatusCode::kCancelled, "interrupted");
}

// The rate of the current stage, from one report to the next.
class StageRate {
 public:
  double Update(const BuildProgress& p) {
    const auto now = std::chrono::steady_clock::now();
    if (p.stage != stage_ || p.round != round_) {
      stage_ = p.stage;
      round_ = p.round;
      begin_ = now;
      first_ = p.triangles_done;
    }
    const double seconds = std::chrono::duration<double>(now - begin_).count();
    return seconds > 0.05 ? static_cast<double>(p.triangles_done - first_) / seconds : 0;
  }

 private:
  std::string stage_;
  uint32_t round_ = 0;
  uint64_t first_ = 0;
  std::chrono::steady_clock::time_point begin_;
};

void PrintSummary(const ObjectRecord& r, uint64_t file_bytes) {
  std::printf("%s: %s\n", r.name.c_str(), SurfaceText(r).c_str());
  const InputReport& in = r.input;
  const auto note = [](uint64_t count, const char* what) {
    if (count != 0) std::printf("  %s %s\n", Grouped(count).c_str(), what);
  };
  note(in.degenerate_triangles, "triangles with two equal vertices dropped");
  note(in.duplicate_triangles, "duplicate triangles dropped");
  note(in.unreferenced_vertices, "vertices without a triangle dropped");
  note(in.two_sided_triangles, "pairs of triangles back to back; each is one two-sided triangle");
  note(in.nonmanifold_edges, "non-manifold edges; where they form chains, these are simplified");
  note(in.nonmanifold_vertices,
       "vertices where such edges end or meet, or parts touch; they stay as long as these do");
  note(in.inconsistent_edges, "of these edges have two triangles that disagree about the outside");
  note(in.turned_triangles, "triangles turned over, so that their sheets are consistent");
  note(in.unorientable_sheets,
       "sheets with one side only, as a Moebius band; they cannot be oriented");
  std::printf("  %.1f bits per vertex; the store has %s\n", BitsPerVertex(r),
              SizeText(file_bytes).c_str());
}

// Whether an ingest of this journal published its object and was killed before it removed the
// journal. One that is not to be gone on with is removed here: its command may now be refused.
bool Finished(const BuildOptions& options, const std::string& store, const std::string& name) {
  const auto published = [&]() -> Result<ObjectRecord> {
    MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database, Database::Open(store));
    return database->Find(name);
  }();
  if (!published.ok()) return false;
  const std::span<const ObjectRecord> one(&*published, 1);
  const Result<JournalInfo> journal = ReadJournalInfo(options.journal_path, one);
  if (!journal.ok() || !journal->finished) return false;
  if (!options.resume) RemoveFinishedJournal(options.journal_path, one);
  return true;
}

// An ingest of this name was interrupted, and this one begins anew.
void SayResumable(const BuildOptions& options, const std::string& name) {
  if (options.resume) return;
  const Result<JournalInfo> journal = ReadJournalInfo(options.journal_path, {});
  if (!journal.ok() || journal->finished || journal->in_use || journal->bytes == 0) return;
  std::fprintf(stderr,
               "mtdb: an ingest of %s was interrupted after %s of work, which this one begins "
               "anew; with --resume it would go on\n",
               name.c_str(), SizeText(journal->bytes).c_str());
}

// The options that concern the mesh and the machine, not what becomes of it.
BuildOptions OptionsOf(const IngestArguments& arguments, const std::string& store) {
  BuildOptions options;
  options.mode = arguments.lossless ? PositionMode::kLossless : PositionMode::kGrid;
  options.bits = arguments.bits;
  options.height_field = arguments.terrain;
  options.step = arguments.step;
  options.weld = arguments.weld;
  options.keep_apart = arguments.keep_apart;
  options.orient = arguments.orient;
  options.texture_step = arguments.texture_step;
  options.drop_texture = arguments.drop_texture;
  options.normal_bits = arguments.normal_bits;
  options.attribute_steps = arguments.attribute_steps;
  options.up = arguments.up;
  options.units = arguments.units;
  options.threads = arguments.threads;
  options.memory_bytes =
      arguments.memory_bytes.value_or(std::max(MachineMemory() / 4, uint64_t{256} << 20));
  options.max_tmp_bytes = arguments.max_tmp_bytes.value_or(options.max_tmp_bytes);
  options.tmp_directory = arguments.tmp.empty() ? FolderOf(store) : arguments.tmp;
  return options;
}

std::string ShownName(const std::string& input) { return input == "-" ? "standard input" : input; }

// What the readers say begins with the file; what the builder finds does not.
Status WithFile(const IngestArguments& arguments, const Status& status) {
  const std::string& message = status.message();
  const bool names_file = std::any_of(
      arguments.inputs.begin(), arguments.inputs.end(),
      [&](const std::string& path) { return message.starts_with(ShownName(path) + ":"); });
  if (status.code() != StatusCode::kBadInput || names_file) return status;
  const size_t others = arguments.inputs.size() - 1;
  return BadInput(ShownName(arguments.inputs[0]) +
                  (others == 0 ? "" : " and " + std::to_string(others) + " more") + ": " + message);
}

// Reads the inputs, which must outlive it. While files are read, the build's spools take less than
// the other half of the memory.
MeshProducer Reading(const std::vector<MeshInput>& inputs, const BuildOptions& options,
                     std::vector<std::string>* notes) {
  return [&inputs, soup_bytes = options.memory_bytes / 2, notes](MeshSink& sink) {
    return ReadMeshes(inputs, sink, notes, soup_bytes);
  };
}

// Opens the inputs; what their copies take of the temporary files is left to the build less.
Result<std::vector<MeshInput>> OpenLimited(const IngestArguments& arguments,
                                           BuildOptions* options) {
  MTDB_ASSIGN_OR_RETURN(std::vector<MeshInput> inputs,
                        OpenMeshes(arguments.inputs, arguments.format, options->tmp_directory,
                                   {options->max_tmp_bytes, LookForInterrupt}));
  for (const MeshInput& input : inputs) options->max_tmp_bytes -= input.temporary_bytes();
  return inputs;
}

void PrintNotes(const std::vector<std::string>& notes) {
  for (const std::string& note : notes) std::printf("  note: %s\n", note.c_str());
}

}  // namespace

Status Survey(const IngestArguments& arguments) {
  MTDB_RETURN_IF_ERROR(CheckNoPicture(arguments.inputs));
  MTDB_RETURN_IF_ERROR(CheckNoStore(arguments.inputs));
  BuildOptions options = OptionsOf(arguments, RealStorePath(arguments.store));
  std::vector<std::string> notes;
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<RasterIngest> raster,
                        RasterIngest::Open(arguments, options.memory_bytes));
  if (raster != nullptr) {
    if (arguments.json) {
      PrintAnswer("raster", raster->InfoJson());
    } else {
      raster->Print(ShownName(arguments.inputs[0]));
    }
    return Status::Ok();
  }
  MTDB_ASSIGN_OR_RETURN(const std::vector<MeshInput> inputs, OpenLimited(arguments, &options));
  const auto read = Reading(inputs, options, &notes);
  const Result<MeshSurvey> survey = SurveyMesh(read, options);
  if (!survey.ok()) return WithFile(arguments, survey.status());
  if (arguments.dry_run && !survey->refusal.ok()) return WithFile(arguments, survey->refusal);
  if (arguments.json) {
    Json json = SurveyJson(*survey);
    json["inputs"] = arguments.inputs;
    json["notes"] = notes;
    PrintAnswer("survey", json);
    return Status::Ok();
  }
  PrintSurvey(ShownName(arguments.inputs[0]), *survey);
  PrintNotes(notes);
  return Status::Ok();
}

namespace {

Status Ingest(const IngestArguments& arguments) {
  MTDB_RETURN_IF_ERROR(CheckNoPicture(arguments.inputs));
  MTDB_RETURN_IF_ERROR(CheckNoStore(arguments.inputs));
  const std::string store = RealStorePath(arguments.store);
  BuildOptions options = OptionsOf(arguments, store);
  const std::string name = arguments.name.empty() ? Stem(arguments.inputs[0]) : arguments.name;

  options.journal_path = JournalPath(options.tmp_directory, store, name);
  options.journal_note = JournalNote(store, name, arguments.resume_command);
  options.resume = arguments.resume;
  // The first one ends the ingest where it can go on, the second one the process.
  const auto interrupt = [](int signal) {
    g_interrupted = 1;
    std::signal(signal, SIG_DFL);
  };
  std::signal(SIGINT, interrupt);
  std::signal(SIGTERM, interrupt);

  // To go on with what was published before it was killed is to publish the same again.
  const bool finished = Finished(options, store, name);
  if (!arguments.quiet && !arguments.json) SayResumable(options, name);
  LateWriter writer(arguments.store, name, arguments.replace || (finished && arguments.resume));
  MTDB_RETURN_IF_ERROR(writer.Check());
  if (arguments.dry_run) return Survey(arguments);
  ProgressLine progress(arguments.quiet || arguments.json);
  progress.Update(0, "reading");
  std::vector<std::string> notes;
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<RasterIngest> raster,
                        RasterIngest::Open(arguments, options.memory_bytes));
  std::vector<MeshInput> inputs;
  MeshProducer read;
  if (raster != nullptr) {
    options.terrain = raster->terrain();
    options.height_field = false;
    read = [&](MeshSink& sink) { return raster->Read(sink); };
  } else {
    MTDB_ASSIGN_OR_RETURN(inputs, OpenLimited(arguments, &options));
    read = Reading(inputs, options, &notes);
  }
  BuildReport report;
  StageRate rate;
  const auto on_progress = [&](const BuildProgress& p) {
    MTDB_RETURN_IF_ERROR(LookForInterrupt());
    progress.Update(p.overall, Describe(p, rate.Update(p)));
    return Status::Ok();
  };
  Result<ObjectRecord> record = BuildObject(read, options, writer, on_progress, &report);
  progress.Finish();
  if (!record.ok()) {
    if (report.journal_left) {
      const StatusCode code = record.status().code();
      return Status(code, record.status().message() + "; the same command with --resume" +
                              (code == StatusCode::kAlreadyExists ? " --replace" : "") +
                              " goes on where it stopped");
    }
    return WithFile(arguments, record.status());
  }
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, writer.StoreBytes());
  if (raster != nullptr) notes = raster->Notes();
  notes.insert(notes.end(), report.texture_notes.begin(), report.texture_notes.end());
  if (arguments.json) {
    Json json = RecordJson(*record, file_bytes);
    json["accuracy"] = AccuracyJson(report.survey);
    json["welded_vertices"] = report.survey.welded_vertices;
    json["equal_vertices"] = report.survey.equal_vertices;
    json["warnings"] = AccuracyWarnings(report.survey);
    json["notes"] = notes;
    if (raster != nullptr) json["raster_input"] = raster->ReportJson();
    json["stages"] = Json::Array();
    for (const StageCost& stage : report.stages) {
      json["stages"].push_back({{"stage", stage.stage},
                                {"seconds", stage.seconds},
                                {"cpu_seconds", stage.cpu_seconds},
                                {"temporary_bytes", stage.tmp_bytes}});
    }
    PrintAnswer("ingest", json);
  } else if (!arguments.quiet) {
    PrintSummary(*record, file_bytes);
    std::printf("  %s\n", AccuracyLine(report.survey).c_str());
    if (arguments.weld || report.survey.welded_vertices != 0) {
      std::printf("  %s vertices welded to others%s\n",
                  Grouped(report.survey.welded_vertices).c_str(),
                  arguments.weld ? "" : ", where the mesh was cut; --no-weld keeps the cuts");
    }
    if (report.survey.equal_vertices != 0 && !report.survey.attributes_differ) {
      std::printf("  %s vertices lie where others do, and stay; --weld would join them\n",
                  Grouped(report.survey.equal_vertices).c_str());
    }
    if (arguments.verbose) PrintStages(report, *record);
    for (const std::string& warning : AccuracyWarnings(report.survey)) {
      std::printf("  warning: %s\n", warning.c_str());
    }
    PrintNotes(notes);
  }
  return Status::Ok();
}

void AddInputs(VerbOptions* verb, std::vector<std::string>* paths, IngestArguments* a) {
  verb->Add("INPUT... STORE", *paths,
            "mesh files (" + SuffixesOf(ReadMeshFormats()) +
                ", also compressed by gzip, or - for standard input; several become one "
                "object), or rasters of heights (" +
                OwnRasterSuffixes() + (HasGdal() ? ", and what GDAL reads" : "") +
                "; several of one grid are joined), then the store, which is made when it "
                "is not there")
      .Required()
      .Values(2, 1 << 20);
  AddInputFormat(verb, &a->format);
  verb->Add("--name", a->name, "the object's name (default: INPUT without folders and extension)")
      .Form("NAME")
      .Check([](const std::string& text) { return CheckObjectName(text).message(); });
}

void AddRounding(VerbOptions* verb, IngestArguments* a) {
  const VerbOption bits =
      verb->Add("--bits", a->bits,
                "round positions to a grid of 2^N cells along the longest side, "
                "N from 1 to 24 (default: a grid that suits the mesh, of 16 bits "
                "or more; --dry-run says which)")
          .Form("N")
          .Between(1, 24);
  const VerbOption step = AddParsed(verb, "--step", "S", &a->step, ParsePositive,
                                    "round positions to multiples of S model units instead");
  AddParsed(verb, "--height-step", "S", &a->step_z, ParsePositive,
            "rasters: round heights to multiples of S (default: integers and decimals as they are "
            "written; other floats so that rounding is small beside their range and differences; "
            "'mtdb info FILE' says it)");
  verb->Add("--fill", a->fill,
            "rasters: close holes of up to N columns and rows of samples (pixels) with a "
            "smooth surface; larger ones and the outside stay")
      .Form("N")
      .Between(1, 1 << 20);
  verb->AddFlag("--terrain", a->terrain,
                "the mesh is a height field, z above x and y, and becomes a terrain: errors are "
                "differences in height; one that is folded is refused");
  const VerbOption lossless =
      verb->AddFlag("--lossless", a->lossless, "keep float32 positions bit for bit");
  bits.Excludes(step).Excludes(lossless);
  step.Excludes(lossless);
}

void AddWeld(VerbOptions* verb, IngestArguments* a) {
  // A word that is no tolerance is mostly the next argument.
  verb->AddText(
          "--weld",
          [a](const std::string& text) -> Status {
            const auto tolerance = ParseNonNegative(text.empty() ? "0" : text);
            if (!tolerance.ok()) {
              return InvalidArgument(tolerance.status().message() +
                                     "; write --weld=0 before other arguments");
            }
            a->weld = *tolerance;
            return Status::Ok();
          },
          "join vertices of equal positions, or of positions within TOLERANCE model units, into "
          "one: several files, or tiles that adjoin, become one surface")
      .Form("[TOLERANCE]")
      .Values(0, 1);
  verb->AddFlag("--no-weld", a->keep_apart,
                "keep cuts in the mesh (default: joined where attributes agree)")
      .Excludes("--weld");
  verb->AddFlag("--orient", a->orient,
                "turn triangles over where those of a sheet disagree about the outside, as few as "
                "possible");
}

void AddAttributes(VerbOptions* verb, IngestArguments* a) {
  verb->Add("--normal-bits", a->normal_bits,
            "keep of normals (nx, ny, nz) the direction only, in N bits a component, N from "
            "4 to 16, e.g. 10 (default: lossless)")
      .Form("N")
      .Between(4, 16);
  AddParsedList(
      verb, "--attribute-step", "NAME=STEP", &a->attribute_steps, ParseAttributeStep,
      "round a float attribute to multiples of a step (default: lossless); may be repeated");
  verb->AddFlag("--drop-texture", a->drop_texture,
                "leave texture coordinates and images out, so that seams of the texture hold no "
                "vertex (default: kept)");
  AddParsed(verb, "--texture-step", "STEP", &a->texture_step, ParseNonNegative,
            "round texture coordinates to multiples of STEP, 0 to keep them as they are (default: "
            "an eighth of a texel of the largest image)");
  AddParsed(verb, "--up", "AXIS", &a->up, ParseUp,
            "what is up in pictures and in the viewer: x, y, z, -x, -y, -z (as --up=-y), or a "
            "vector X,Y,Z (default: found from the shape; terrains: z)");
  AddParsed(verb, "--units", "UNIT", &a->units, ParseLengthUnit,
            "what coordinates are in: um, mm, cm, m, km, in or ft; kept and shown, and changes no "
            "number");
}

void AddWork(VerbOptions* verb, IngestArguments* a) {
  verb->Add("--threads", a->threads, "use N threads (default: one per core)")
      .Form("N")
      .Between(1, 1024);
  AddParsed(verb, "--memory", "SIZE", &a->memory_bytes, ParseMemory,
            "use at most so much memory, the rest goes to temporary files, e.g. 1G; at least 256M "
            "(default: a quarter of the machine's)");
  verb->Add("--tmp", a->tmp, "folder of temporary files (default: the store's)").Form("DIR");
  AddParsed(verb, "--max-tmp", "SIZE", &a->max_tmp_bytes, ParseSize,
            "temporary files and the journal take at most so much (default: all there is)");
  verb->AddFlag("--resume", a->resume, "go on where an interrupted ingest of this input stopped");
  verb->AddFlag("--replace", a->replace, "replace an object of that name");
  verb->AddFlag("--dry-run", a->dry_run,
                "store nothing; tell what the mesh is like, which accuracy suits it, and what it "
                "takes")
      .Excludes("--resume");
  AddJson(verb, &a->json);
  AddVerbose(verb, &a->verbose);
}

// What single options cannot see.
Status CheckPaths(const std::vector<std::string>& paths, const IngestArguments& a) {
  const auto count = std::count(paths.begin(), paths.end() - 1, "-");
  if (count > 1) return InvalidArgument("-: standard input can be read once");
  if (paths.front() == "-" && a.name.empty() && !a.dry_run) {
    return InvalidArgument("-: standard input has no name: give the object one by --name");
  }
  if (count == 0 && !a.format.empty()) {
    return InvalidArgument("--format: goes with - only; files are known by their names");
  }
  if (Database::IsUrl(paths.back())) {
    return InvalidArgument(paths.back() + ": a URL cannot be written to; give a file");
  }
  if (count == 1 && a.resume) {
    return InvalidArgument("--resume: cannot read standard input again; copy it to a file");
  }
  return Status::Ok();
}

RunVerb AddIngest(VerbOptions* verb) {
  const auto a = std::make_shared<IngestArguments>();
  const auto paths = std::make_shared<std::vector<std::string>>();
  AddInputs(verb, paths.get(), a.get());
  AddRounding(verb, a.get());
  AddWeld(verb, a.get());
  AddAttributes(verb, a.get());
  AddWork(verb, a.get());
  verb->CheckAll([a, paths] { return CheckPaths(*paths, *a); });
  return [a, paths](Invocation& invocation) {
    a->store = paths->back();
    a->inputs.assign(paths->begin(), paths->end() - 1);
    a->resume_command = invocation.command + (a->resume ? "" : " --resume");
    a->quiet = invocation.quiet;
    return Ingest(*a);
  };
}

}  // namespace

const Verb kIngestVerb{"ingest", "store a mesh at every level of detail",
                       "Example: mtdb ingest scan.ply scans.mtdb --name statue --bits 18",
                       AddIngest};

}  // namespace mtdb
