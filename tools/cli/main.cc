// SPDX-License-Identifier: Apache-2.0
// mtdb: the command line. Exit status 0 success, 1 error, 2 usage: a command line that no store
// and no file could make right.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <poll.h>
#include <string>
#include <system_error>
#include <unistd.h>
#include <utility>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "codecs/raster_file/raster_file.h"
#include "store/base/redact.h"
#include "store/object_name.h"
#include "tools/cli/did_you_mean.h"
#include "tools/cli/manual.h"
#include "tools/cli/options.h"
#include "tools/cli/raster_output.h"
#include "tools/cli/verbs.h"
#include "tools/cli/verbs/follow_path.h"
#include "tools/cli/verbs/tile.h"
#include "tools/client/client.h"
#include "tools/client/printable.h"
#include "tools/gdal/gdal_raster.h"
#include "tools/request/arguments.h"
#include "tools/request/query_options.h"

namespace {

using mtdb::AddImplicit;
using mtdb::AddJson;
using mtdb::AddName;
using mtdb::AddParsed;
using mtdb::AddParsedList;
using mtdb::AddPictureOptions;
using mtdb::AddQueryOptions;
using mtdb::AddServe;
using mtdb::AddVerbose;

constexpr int kExitError = 1;
constexpr int kExitUsage = 2;

constexpr size_t kHelpColumn = 28;
constexpr size_t kHelpWidth = 70;  // of the text in it

std::string Wrap(const std::string& text) {
  std::string wrapped;
  size_t begin = 0;
  while (text.size() - begin > kHelpWidth) {
    const size_t space = text.rfind(' ', begin + kHelpWidth);
    if (space == std::string::npos || space <= begin) break;
    wrapped += text.substr(begin, space - begin) + "\n";
    begin = space + 1;
  }
  return wrapped + text.substr(begin);
}

// Help without CLI11's notes on types, ranges and exclusions: the descriptions say it in words.
class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter() { column_width(kHelpColumn); }
  std::string make_option_opts(const CLI::Option* option) const override {
    if (option->get_type_size() == 0 || option->get_positional()) return "";
    const std::string type = option->get_type_name();
    return " " + type.substr(0, type.find(':'));
  }
  std::string make_option_usage(const CLI::Option* option) const override {
    return option->get_name(true);
  }
  std::string make_option_desc(const CLI::Option* option) const override {
    const std::string text = option->get_default_str();
    return Wrap(option->get_description() + (text.empty() ? "" : " (default: " + text + ")"));
  }
  std::string make_footer(const CLI::App* app) const override {
    const std::string footer = app->get_footer();
    return footer.empty() ? "" : footer + "\n";
  }
};

void AddCache(CLI::App* verb, mtdb::QueryArguments* arguments) {
  AddParsed(verb, "--cache", "SIZE", &arguments->cache_bytes, mtdb::ParseSize,
            "let decoded clusters take at most so much memory, e.g. 1.5G (default: a quarter of "
            "the machine's)");
}

// `may_be_raster`: a terrain's.
void AddOutput(CLI::App* verb, std::string* output, bool may_be_standard,
               bool may_be_raster = false) {
  const std::string what = "the mesh file: " + mtdb::SuffixesOf(mtdb::WrittenMeshFormats()) +
                           (may_be_standard ? ", or - for standard output (see --format)" : "") +
                           (may_be_raster ? "; of a terrain also a raster: .tif, .asc, .hgt" : "");
  mtdb::IsWritten(verb->add_option("OUTPUT", *output, what))
      ->required()
      ->check([=](const std::string& text) {
        if (may_be_standard && text == "-") return std::string();
        if (may_be_raster && mtdb::IsRasterOutput(text)) return std::string();
        return mtdb::WrittenMeshFormatOf(text).status().message();
      });
}

// Of what is written to standard output.
void AddOutputFormat(CLI::App* verb, mtdb::QueryArguments* a) {
  verb->add_option("--format", a->output_format,
                   "the format of standard output: ply, obj, stl, off or drc")
      ->type_name("FORMAT")
      ->check([](const std::string& text) {
        return mtdb::FindWrittenMeshFormat(text).status().message();
      });
}

// A server's URL.
void AddUrl(CLI::App* verb, std::string* url) {
  verb->add_option("URL", *url, "http://HOST:PORT or http://HOST:PORT/objects/NAME")
      ->required()
      ->check([](const std::string& text) { return mtdb::CheckUrl(text).message(); });
}

void AddTimeout(CLI::App* verb, double* seconds) {
  AddParsed(verb, "--timeout", "SECONDS", seconds, mtdb::ParsePositiveSeconds,
            "give up when the server does nothing for so long")
      ->default_str("600");
}

void AddFollow(CLI::App* verb, mtdb::FollowArguments* a) {
  AddUrl(verb, &a->url);
  verb->add_option("--path", a->path,
                   "what to ask for: a JSON object a line, a query of its own or a keyframe; "
                   "required")
      ->required()
      ->type_name("FILE");
  verb->add_option("--output", a->output,
                   "write the mesh of each step; %d or %03d stands for the step: step-%03d.ply")
      ->type_name("PATTERN")
      ->check([](const std::string& text) {
        const mtdb::Status status = mtdb::StepFile(text, 0).status();
        return status.ok() ? mtdb::WrittenMeshFormatOf(text).status().message() : status.message();
      });
  verb->add_option("--csv", a->csv,
                   "write a table of bytes, milliseconds and triangles, a row a step")
      ->type_name("FILE");
  AddName(verb, &a->name, "which object; needed when the server has several");
  verb->add_option("--remember", a->remembered_vertices,
                   "remember N removed vertices, so that they need not come again")
      ->type_name("N")
      ->check(CLI::Range(0u, 1u << 24))
      ->capture_default_str();
  AddTimeout(verb, &a->timeout_seconds);
  AddParsed(verb, "--reconnect", "SECONDS", &a->reconnect_seconds, mtdb::ParseSeconds,
            "when the connection is lost, try so long to get another, and go on from the base mesh")
      ->default_str("0");
  AddJson(verb, &a->json);
}

// Of what is read.
void AddFormat(CLI::App* verb, std::string* format) {
  verb->add_option("--format", *format,
                   "the format of standard input, where its content does not tell it: " +
                       mtdb::SuffixesOf(mtdb::ReadMeshFormats()) + ", without the dot")
      ->type_name("FORMAT")
      ->check([](const std::string& text) {
        return mtdb::FindReadMeshFormat(text).status().message();
      });
}

void AddIngest(CLI::App* verb, std::vector<std::string>* paths, mtdb::IngestArguments* a) {
  verb->add_option("INPUT... STORE", *paths,
                   "mesh files (" + mtdb::SuffixesOf(mtdb::ReadMeshFormats()) +
                       ", also compressed by gzip, or - for standard input; several become one "
                       "object), or rasters of heights (" +
                       mtdb::OwnRasterSuffixes() +
                       (mtdb::HasGdal() ? ", and what GDAL reads" : "") +
                       "; several of one grid are joined), then the store, which is made when it "
                       "is not there")
      ->required()
      ->expected(2, 1 << 20);
  AddFormat(verb, &a->format);
  verb->add_option("--name", a->name,
                   "the object's name (default: INPUT without folders and extension)")
      ->type_name("NAME")
      ->check([](const std::string& text) { return mtdb::CheckObjectName(text).message(); });
  auto* bits = verb->add_option("--bits", a->bits,
                                "round positions to a grid of 2^N cells along the longest side, "
                                "N from 1 to 24 (default: a grid that suits the mesh, of 16 bits "
                                "or more; --dry-run says which)")
                   ->type_name("N")
                   ->check(CLI::Range(1, 24));
  auto* step = AddParsed(verb, "--step", "S", &a->step, mtdb::ParsePositive,
                         "round positions to multiples of S model units instead");
  AddParsed(verb, "--step-z", "S", &a->step_z, mtdb::ParsePositive,
            "rasters: round heights to multiples of S (default: integers and decimals as they are "
            "written; other floats so that rounding is small beside their range and differences; "
            "'mtdb info FILE' says it)");
  verb->add_option("--fill", a->fill,
                   "rasters: close holes of up to N columns and rows of samples (pixels) with a "
                   "smooth surface; larger ones and the outside stay")
      ->type_name("N")
      ->check(CLI::Range(1, 1 << 20));
  verb->add_flag("--terrain", a->terrain,
                 "the mesh is a height field, z above x and y, and becomes a terrain: errors are "
                 "differences in height; one that is folded is refused");
  auto* lossless = verb->add_flag("--lossless", a->lossless, "keep float32 positions bit for bit");
  bits->excludes(step)->excludes(lossless);
  step->excludes(lossless);
  // A word that is no tolerance is mostly the next argument.
  verb->add_option_function<std::string>(
          "--weld",
          [a](const std::string& text) {
            const auto tolerance = mtdb::ParseNonNegative(text.empty() ? "0" : text);
            if (!tolerance.ok()) {
              throw CLI::ValidationError("--weld", tolerance.status().message() +
                                                       "; write --weld=0 before other arguments");
            }
            a->weld = *tolerance;
          },
          "join vertices of equal positions, or of positions within TOLERANCE model units, into "
          "one: several files, or tiles that adjoin, become one surface")
      ->type_name("[TOLERANCE]")
      ->expected(0, 1);
  verb->add_flag("--no-weld", a->keep_apart,
                 "keep cuts in the mesh (default: joined where attributes agree)")
      ->excludes("--weld");
  verb->add_option("--normals", a->normal_bits,
                   "keep of normals (nx, ny, nz) the direction only, in N bits a component, N from "
                   "4 to 16, e.g. 10 (default: lossless)")
      ->type_name("N")
      ->check(CLI::Range(4, 16));
  AddParsedList(
      verb, "--attribute", "NAME=STEP", &a->attribute_steps, mtdb::ParseAttributeStep,
      "round a float attribute to multiples of a step (default: lossless); may be repeated");
  mtdb::AddUpAndUnits(verb, &a->up, &a->units);
  verb->add_option("--threads", a->threads, "use N threads (default: one per core)")
      ->type_name("N")
      ->check(CLI::Range(1, 1024));
  AddParsed(verb, "--memory", "SIZE", &a->memory_bytes, mtdb::ParseMemory,
            "use at most so much memory, the rest goes to temporary files, e.g. 1G; at least 256M "
            "(default: a quarter of the machine's)");
  verb->add_option("--tmp", a->tmp, "folder of temporary files (default: the store's)")
      ->type_name("DIR");
  AddParsed(verb, "--max-tmp", "SIZE", &a->max_tmp_bytes, mtdb::ParseSize,
            "temporary files and the journal take at most so much (default: all there is)");
  verb->add_flag("--resume", a->resume, "go on where an interrupted ingest of this input stopped");
  verb->add_flag("--force", a->force, "replace an object of that name");
  verb->add_flag("--dry-run", a->dry_run,
                 "store nothing; tell what the mesh is like, which accuracy suits it, and what it "
                 "takes")
      ->excludes("--resume");
  verb->add_flag("--quiet", a->quiet, "print nothing but errors");
  AddJson(verb, &a->json);
}

// The command line that goes on with an interrupted ingest of this one.
std::string ResumeCommand(int argc, char** argv, bool resumes) {
  std::string command = "mtdb";
  for (int i = 1; i < argc; ++i) command += " " + mtdb::QuoteForShell(argv[i]);
  return command + (resumes ? "" : " --resume");
}

// One line, whatever names of files and objects are in it.
void PrintError(const std::string& message) {
  std::fprintf(stderr, "mtdb: %s\n", mtdb::Printable(mtdb::WithoutSecrets(message)).c_str());
}

int Usage(const std::string& problem, const std::string& verb) {
  PrintError(problem + "; see 'mtdb help" + (verb.empty() ? "" : " ") + verb + "'");
  return kExitUsage;
}

// `text` is no option of the verb.
std::string NoOption(const CLI::App& verb, const std::string& text) {
  const std::string name = text.substr(0, text.find('='));
  std::vector<std::string> known;
  for (const CLI::Option* option : verb.get_options()) {
    for (const std::string& known_name : option->get_lnames()) known.push_back("--" + known_name);
  }
  return "no option '" + name + "'" + mtdb::DidYouMean(name, known);
}

// The option or argument that was given as '', which is no value of any.
std::string EmptyValue(const CLI::App& verb) {
  for (const CLI::Option* option : verb.get_options()) {
    if (option->get_type_size() == 0 || option->get_expected_min() == 0) continue;  // flags
    for (const std::string& text : option->results()) {
      if (text.empty()) return option->get_name();
    }
  }
  return "";
}

// Whether standard output is a pipe that nobody reads any more. What could not be written may have
// been lost long ago, and errno with it.
bool ReaderIsGone() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) > 0 && (out.revents & (POLLERR | POLLHUP)) != 0;
}

// The verbs, what their options fill, and what each runs.
class CommandLine {
 public:
  CommandLine();
  int Run(int argc, char** argv);
  // Writes the manual and the completion into a folder: for the build, not for users.
  int WriteManual(const std::string& folder) const {
    const mtdb::Status status = mtdb::WriteManual(app_, MTDB_VERSION, folder);
    if (!status.ok()) PrintError(status.message());
    return status.ok() ? 0 : kExitError;
  }

 private:
  // Returns the new verb. `run` may set `*ok` to false for a failure that was printed already.
  using Verb = std::function<mtdb::Status(bool* ok)>;
  CLI::App* AddVerb(const char* name, const char* description, const char* footer, Verb run);
  void AddIngestVerb();
  void AddInspectVerbs();
  void AddExtractVerb();
  void AddVerifyVerb();
  void AddRenderVerb();
  void AddServerVerbs();
  void AddViewVerb();
  void AddFollowVerb();
  void AddPackVerbs();
  void AddSpaceVerbs();
  void AddGenerateVerb();
  // Exit status where the arguments ask for nothing that is to be run.
  std::optional<int> Parse(std::vector<std::string> arguments);

  CLI::App app_{"mtdb: an out-of-core database of triangle meshes"};
  std::vector<std::pair<const CLI::App*, Verb>> verbs_;
  std::vector<std::string> paths_;  // of ingest
  mtdb::IngestArguments ingest_;
  mtdb::InspectArguments inspect_;
  mtdb::PackArguments pack_;
  mtdb::SpaceArguments space_;
  mtdb::QueryArguments query_;
  mtdb::ProbeArguments probe_;
  mtdb::ProfileArguments profile_;
  mtdb::TileArguments tile_;
  std::string tiles_;  // verify
  mtdb::ServerOptions serve_;
  mtdb::ViewArguments view_;
  mtdb::FollowArguments follow_;
  mtdb::GenerateArguments generate_;
  bool quiet_ = false;  // of all verbs but ingest
};

CommandLine::CommandLine() {
  app_.name("mtdb");
  app_.formatter(std::make_shared<HelpFormatter>());
  app_.get_formatter()->label("SUBCOMMAND", "VERB");
  app_.get_formatter()->label("Positionals", "Arguments");
  app_.set_help_flag("-h,--help", "print this and exit");
  app_.set_version_flag("--version", std::string("mtdb ") + MTDB_VERSION, "print the version");
  app_.require_subcommand(1);
  app_.footer(
      "'mtdb help VERB' explains a verb and its options.\n"
      "Exit status: 0 success, 1 error, 2 wrong usage.");
  AddIngestVerb();
  AddInspectVerbs();
  AddExtractVerb();
  AddVerifyVerb();
  AddRenderVerb();
  mtdb::AddProbe(AddVerb("probe", "find the closest point of a surface, or the first hit of a ray",
                         "Example: mtdb probe scans.mtdb --ray 0,0,500,0,0,-1 --error 0.5",
                         [this](bool*) { return mtdb::Probe(probe_); }),
                 &probe_);
  mtdb::AddProfile(AddVerb("profile", "write the heights of a terrain along a line, as CSV",
                           "Example: mtdb profile alps.mtdb --line 7.1,46.0,7.9,46.4 --error 5",
                           [this](bool*) { return mtdb::ProfileVerb(profile_); }),
                   &profile_);
  mtdb::AddTile(AddVerb("tile", "write tiles for Cesium, QGIS, three.js and others",
                        "Examples: mtdb tile scans.mtdb www/statue --at 11.57,48.14,520\n"
                        "          mtdb tile alps.mtdb www/alps --as quantized-mesh\n"
                        "More: docs/tiles.md",
                        [this](bool*) {
                          tile_.quiet = quiet_;
                          return mtdb::TileVerb(tile_);
                        }),
                &tile_);
  AddServerVerbs();
  AddViewVerb();
  AddFollowVerb();
  AddPackVerbs();
  AddSpaceVerbs();
  AddGenerateVerb();
  const std::pair<const char*, mtdb::OpenOptions*> readers[] = {
      {"info", &inspect_.open},        {"list", &inspect_.open}, {"verify", &inspect_.open},
      {"extract", &query_.open},       {"render", &query_.open}, {"probe", &probe_.open},
      {"profile", &profile_.open},     {"tile", &tile_.open},    {"unpack", &pack_.open},
      {"serve", &serve_.service.open}, {"view", &view_.open}};
  for (const auto& [verb, open] : readers) mtdb::AddCacheDirectory(app_.get_subcommand(verb), open);
}

CLI::App* CommandLine::AddVerb(const char* name, const char* description, const char* footer,
                               Verb run) {
  CLI::App* verb = app_.add_subcommand(name, description);
  verb->group("Verbs");
  verb->footer(footer);
  if (std::string(name) != "ingest") {
    verb->add_flag("--quiet", quiet_, "print nothing but errors, and JSON where it is asked for");
  }
  verbs_.emplace_back(verb, std::move(run));
  return verb;
}

void CommandLine::AddIngestVerb() {
  CLI::App* verb =
      AddVerb("ingest", "store a mesh at every level of detail",
              "Example: mtdb ingest scan.ply scans.mtdb --name statue --bits 18", [this](bool*) {
                ingest_.store = paths_.back();
                ingest_.inputs.assign(paths_.begin(), paths_.end() - 1);
                return mtdb::Ingest(ingest_);
              });
  AddIngest(verb, &paths_, &ingest_);
  AddVerbose(verb, &ingest_.verbose);
  verb->callback([this] {
    const auto count = std::count(paths_.begin(), paths_.end() - 1, "-");
    if (count > 1) throw CLI::ValidationError("-", "standard input can be read once");
    if (paths_.front() == "-" && ingest_.name.empty() && !ingest_.dry_run) {
      throw CLI::ValidationError("-", "standard input has no name: give the object one by --name");
    }
    if (count == 0 && !ingest_.format.empty()) {
      throw CLI::ValidationError("--format", "goes with - only; files are known by their names");
    }
    if (mtdb::Database::IsUrl(paths_.back())) {
      throw CLI::ValidationError(paths_.back(), "a URL cannot be written to; give a file");
    }
    if (count == 1 && ingest_.resume) {
      throw CLI::ValidationError("--resume", "cannot read standard input again; copy it to a file");
    }
  });
}

void AddStore(CLI::App* verb, std::string* store) {
  verb->add_option("STORE", *store, "the store file, or a packed file or its URL")->required();
}

void AddWrittenStore(CLI::App* verb, std::string* store) {
  mtdb::IsWritten(verb->add_option("STORE", *store, "the store file"))->required();
}

void CommandLine::AddInspectVerbs() {
  CLI::App* info = AddVerb("info", "tell what a store holds, or what a mesh file is like", "",
                           [this](bool*) { return mtdb::Info(inspect_); });
  info->add_option("STORE", inspect_.store,
                   "the store file, or a mesh file; - is a mesh on standard input")
      ->required();
  AddFormat(info, &inspect_.format);
  AddName(info, &inspect_.name, "this object only");
  AddJson(info, &inspect_.json);
  info->add_flag("--streams", inspect_.streams,
                 "read all clusters, and tell what their streams take, attributes among them");
  CLI::App* list = AddVerb("list", "list the objects of a store, and ingests that were interrupted",
                           "", [this](bool*) { return mtdb::List(inspect_); });
  AddStore(list, &inspect_.store);
  AddJson(list, &inspect_.json);
  list->add_option("--tmp", inspect_.tmp,
                   "look for journals of interrupted ingests in DIR (default: the store's folder)")
      ->type_name("DIR");
}

void AddNormals(CLI::App* verb, mtdb::QueryArguments* query) {
  verb->add_flag("--normals", query->query.normals,
                 "add the mesh's normals to its vertices (to .off: also those that it has)");
  verb->add_flag("--double", query->double_positions, "to .ply: positions as float64 in any case");
}

void CommandLine::AddExtractVerb() {
  CLI::App* verb =
      AddVerb("extract", "write the mesh of a region at an accuracy",
              "Examples: mtdb extract scans.mtdb head.ply --error 0.5 --sphere 0,0,180,60 --clip\n"
              "          mtdb extract scans.mtdb view.ply --pixels 1 --frustum --eye 0,-900,200 "
              "--target 0,0,100\n"
              "More: docs/query.md",
              [this](bool*) { return mtdb::ExtractVerb(query_); });
  AddStore(verb, &query_.store);
  AddOutput(verb, &query_.output, true, true);
  AddOutputFormat(verb, &query_);
  AddQueryOptions(verb, &query_, false);
  verb->add_option("--drape", query_.drape,
                   "to .glb: with this image over it (a PNG or JPEG with a world file, a GeoTIFF)")
      ->type_name("FILE");
  AddParsed(verb, "--spacing", "D[,DY]", &query_.spacing, mtdb::ParseSpacing,
            "of a terrain to .tif (with GDAL), .asc or .hgt: samples so far apart (default: the "
            "raster's own)");
  AddParsed(verb, "--window", "X0,Y0,X1,Y1", &query_.window, mtdb::ParseWindow,
            "of a terrain to a raster: the samples of this part");
  AddCache(verb, &query_);
  AddImplicit(verb, &query_.implicit);
  AddNormals(verb, &query_);
}

void CommandLine::AddVerifyVerb() {
  CLI::App* verb =
      AddVerb("verify", "check a store's bytes and meshes, or tiles", "", [this](bool* ok) {
        return tiles_.empty() ? mtdb::Verify(inspect_, ok)
                              : mtdb::VerifyTilesVerb(inspect_, tiles_, ok);
      });
  AddStore(verb, &inspect_.store);
  AddName(verb, &inspect_.name, "this object only");
  AddJson(verb, &inspect_.json);
  verb->add_option("--level", inspect_.level,
                   "fast: pages, checksums, index, digests; full: also decodes every cluster; "
                   "global: also rebuilds the whole surface and compares it with what was ingested")
      ->type_name("LEVEL")
      ->check(CLI::IsMember({"fast", "full", "global"}))
      ->capture_default_str();
  verb->add_option(
          "--tiles", tiles_,
          "instead check the tiles in DIR ('mtdb tile'): files, boxes, errors, and distances "
          "from the object")
      ->type_name("DIR");
}

void CommandLine::AddRenderVerb() {
  CLI::App* verb =
      AddVerb("render", "draw what extract would write",
              "Examples: mtdb render scans.mtdb coarse.png --error-rel 0.002 --wireframe\n"
              "          mtdb render scans.mtdb error.png --colour error --error-rel 0.002 "
              "--view top\n"
              "Where the surface is blue, its back is seen: the inside of an open scan, or "
              "triangles whose orientation\nis wrong in the input. More: docs/guide.md",
              [this](bool*) { return mtdb::RenderVerb(query_); });
  AddStore(verb, &query_.store);
  mtdb::IsWritten(verb->add_option("OUT.png", query_.output, "the picture: .png, .jpg or .jpeg"))
      ->required()
      ->check([](const std::string& text) { return mtdb::CheckPictureName(text).message(); });
  AddQueryOptions(verb, &query_, true);
  AddCache(verb, &query_);
  AddPictureOptions(verb, &query_);
}

void CommandLine::AddViewVerb() {
  CLI::App* view = AddVerb("view", "look at a store's objects in the browser",
                           "Serves STORE on this machine alone, prints the URL, and opens it by "
                           "xdg-open. Ends with SIGINT (Ctrl-C) or SIGTERM.\n"
                           "Example: mtdb view scans.mtdb\n"
                           "To choose limits, or to let others look: mtdb serve, whose URL shows "
                           "the same page.\n"
                           "For web servers without mtdb: mtdb view --write-page www; mtdb pack "
                           "scans.mtdb www/scan.mtdbp; then index.html?src=scan.mtdbp",
                           [this](bool*) { return mtdb::View(view_); });
  mtdb::AddView(view, &view_);
}

void CommandLine::AddServerVerbs() {
  CLI::App* serve =
      AddVerb("serve", "give meshes and sessions to clients over HTTP",
              "Prints the server's URL. Ends with SIGINT (Ctrl-C) or SIGTERM.\n"
              "Examples: mtdb serve scans.mtdb --listen 127.0.0.1:8080\n"
              "          curl http://127.0.0.1:8080/objects\n"
              "          curl 'http://127.0.0.1:8080/objects/statue/mesh?error=0.5&format=glb' "
              "-o statue.glb\n"
              "More: docs/protocol.md",
              [this](bool*) { return mtdb::Serve(serve_); });
  AddServe(serve, &serve_);
  CLI::App* fetch =
      AddVerb("fetch", "extract from a server (mtdb serve)",
              "Example: mtdb fetch http://localhost:8080/objects/statue head.ply --error 0.5 "
              "--sphere 0,0,180,60\n"
              "More: docs/query.md, docs/protocol.md",
              [this](bool*) { return mtdb::Fetch(query_); });
  AddUrl(fetch, &query_.store);
  AddOutput(fetch, &query_.output, false);
  AddQueryOptions(fetch, &query_, false);
  AddTimeout(fetch, &query_.timeout_seconds);
  AddNormals(fetch, &query_);
}

void CommandLine::AddFollowVerb() {
  CLI::App* verb =
      AddVerb("follow", "drive a session of a server (mtdb serve) along a path of queries",
              "A line of FILE is a query (docs/query.md), or has short forms of one:\n"
              "  {\"camera\": {\"eye\": [0, -9, 4], \"target\": [0, 0, 3]}, \"pixels\": 1}\n"
              "  {\"camera\": {\"eye\": [9, 0, 4], \"target\": [0, 0, 3]}, \"pixels\": 1, "
              "\"steps\": 30}\n"
              "  {\"box\": {\"min\": [0, 0, 0], \"max\": [1, 1, 1]}, \"error\": 0.01}\n"
              "With \"steps\" so many queries lead from the line before to this one, along a "
              "straight line.\n"
              "Example: mtdb follow http://localhost:8080/objects/statue --path flight.jsonl "
              "--output step-%03d.ply --csv flight.csv\n"
              "More: docs/protocol.md",
              [this](bool*) { return mtdb::Follow(follow_); });
  AddFollow(verb, &follow_);
}

void CommandLine::AddSpaceVerbs() {
  CLI::App* remove = AddVerb(
      "remove", "remove objects from a store",
      "The file keeps its size: the next objects fill the room, or 'mtdb compact' gives it back.\n"
      "Example: mtdb remove scans.mtdb statue vase",
      [this](bool*) { return mtdb::Remove(space_); });
  AddWrittenStore(remove, &space_.store);
  remove->add_option("NAME", space_.names, "the objects")->required()->expected(1, 1 << 20);
  AddJson(remove, &space_.json);
  CLI::App* rename = AddVerb("rename", "give an object another name",
                             "Example: mtdb rename scans.mtdb scan statue",
                             [this](bool*) { return mtdb::Rename(space_); });
  AddWrittenStore(rename, &space_.store);
  rename->add_option("OLD NEW", space_.names, "the object's name, and its new name")
      ->required()
      ->expected(2)
      ->type_size(1);
  AddJson(rename, &space_.json);
  CLI::App* copy = AddVerb(
      "copy", "copy objects into another store, or make a backup",
      "A TARGET that is not there appears when the copy is complete, with what STORE had at one "
      "moment.\nInto one that is there go the objects that it has not; an object that differs "
      "under\nthe same name is an error, or replaced with --force.\n"
      "Examples: mtdb copy scans.mtdb backup.mtdb\n"
      "          mtdb copy scans.mtdb museum.mtdb statue vase",
      [this](bool*) { return mtdb::Copy(space_); });
  AddStore(copy, &space_.store);
  mtdb::IsWritten(copy->add_option("TARGET", space_.target, "the other store"))->required();
  copy->add_option("NAME", space_.names, "the objects (default: all)")->expected(0, 1 << 20);
  copy->add_flag("--force", space_.force, "replace objects of TARGET that differ");
  AddJson(copy, &space_.json);
  CLI::App* compact = AddVerb(
      "compact", "make a store's file as small as its objects",
      "Writes a new file beside the old one and puts it in its place in one step; the disk must "
      "have\nroom for both. Nobody may write to the store meanwhile.\n"
      "Example: mtdb compact scans.mtdb",
      [this](bool*) { return mtdb::Compact(space_); });
  AddWrittenStore(compact, &space_.store);
  AddJson(compact, &space_.json);
}

void CommandLine::AddPackVerbs() {
  const auto add_names = [this](CLI::App* verb) {
    verb->add_option("--name", pack_.names, "this object only; several: in this order")
        ->type_name("NAME")
        ->expected(1)
        ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
    AddJson(verb, &pack_.json);
  };
  CLI::App* pack = AddVerb("pack", "write a store's objects into one file for a web server",
                           "Every verb that reads takes the file, or its URL, for a store.\n"
                           "Examples: mtdb pack scans.mtdb statue.mtdbp --name statue\n"
                           "          mtdb info https://example.org/statue.mtdbp\n"
                           "More: docs/packed.md",
                           [this](bool*) { return mtdb::Pack(pack_); });
  AddStore(pack, &pack_.from);
  mtdb::IsWritten(
      pack->add_option("FILE", pack_.to, "the packed file; one of that name is replaced"))
      ->required();
  add_names(pack);
  CLI::App* unpack = AddVerb("unpack", "put a packed file's objects into a store",
                             "Example: mtdb unpack statue.mtdbp scans.mtdb",
                             [this](bool*) { return mtdb::Unpack(pack_); });
  unpack->add_option("FILE", pack_.from, "the packed file, or its URL")->required();
  mtdb::IsWritten(unpack->add_option("STORE", pack_.to, "the store; made if it is not there"))
      ->required();
  add_names(unpack);
  unpack->add_flag("--force", pack_.force, "replace objects of the same names");
}

void CommandLine::AddGenerateVerb() {
  CLI::App* verb = AddVerb("generate", "make a mesh to try things on",
                           "Example: mtdb generate sculpture try.ply --triangles 1000000",
                           [this](bool*) { return mtdb::Generate(generate_); });
  verb->add_option("SHAPE", generate_.shape,
                   "sculpture (closed, with handles and bumps of all sizes) or terrain (a height "
                   "field)")
      ->required()
      ->check(CLI::IsMember({"sculpture", "terrain"}));
  AddOutput(verb, &generate_.output, false);
  const auto parse = [](const std::string& text) -> mtdb::Result<uint64_t> {
    auto count = mtdb::ParseCount(text);
    if (!count.ok() || (*count >= 100 && *count <= 8'300'000'000)) return count;
    return mtdb::Unexpected(text, "a number from 100 to 8300000000");
  };
  AddParsed(verb, "--triangles", "N", &generate_.triangles, parse,
            "about N triangles, from 100 to 8300M (as far as indices of 32 bits go), e.g. 100k; "
            "required")
      ->required();
  AddJson(verb, &generate_.json);
  AddParsed(verb, "--seed", "S", &generate_.seed, mtdb::ParseWholeNumber,
            "another number, another shape")
      ->default_str("1");
}

std::optional<int> CommandLine::Parse(std::vector<std::string> arguments) {
  if (arguments.empty()) {
    std::fprintf(stderr, "%s", app_.help().c_str());
    return kExitUsage;
  }
  // "mtdb help VERB" is "mtdb VERB --help".
  if (arguments[0] == "help") {
    arguments.erase(arguments.begin());
    arguments.resize(std::min<size_t>(arguments.size(), 1));
    arguments.push_back("--help");
  }
  // CLI11 would only say that a verb is missing.
  const std::string& first = arguments[0];
  const auto is_named = [&](const CLI::App* verb) { return verb->get_name() == first; };
  if (first.starts_with('-')) {
    if (app_.get_option_no_throw(first) == nullptr) return Usage(NoOption(app_, first), "");
  } else if (app_.get_subcommands(is_named).empty()) {
    std::vector<std::string> known{"help"};
    for (const auto& [verb, run] : verbs_) known.push_back(verb->get_name());
    return Usage("no verb '" + first + "'" + mtdb::DidYouMean(first, known), "");
  }
  try {
    app_.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::Success& e) {
    return app_.exit(e);
  } catch (const CLI::ParseError& e) {
    const auto verbs = app_.get_subcommands();
    for (const std::string& text :
         verbs.empty() ? std::vector<std::string>() : verbs[0]->remaining()) {
      if (text.starts_with("-")) return Usage(NoOption(*verbs[0], text), verbs[0]->get_name());
    }
    return Usage(e.what(), verbs.empty() ? "" : verbs[0]->get_name());
  }
  if (const std::string empty = EmptyValue(*app_.get_subcommands()[0]); !empty.empty()) {
    return Usage(empty + ": expected a value, found ''", app_.get_subcommands()[0]->get_name());
  }
  return std::nullopt;
}

int CommandLine::Run(int argc, char** argv) {
  if (const auto exit_status = Parse({argv + 1, argv + argc})) return *exit_status;
  ingest_.resume_command = ResumeCommand(argc, argv, ingest_.resume);
  bool ok = true;
  for (const auto& [verb, run] : verbs_) {
    if (!verb->parsed()) continue;
    // A mesh goes by the descriptor, and so still to standard output.
    const CLI::Option* const json = verb->get_option_no_throw("--json");
    if (quiet_ && (json == nullptr || json->count() == 0)) {
      query_.quiet = space_.quiet = pack_.quiet = true;
      if (std::FILE* const nothing = std::fopen("/dev/null", "w")) stdout = nothing;
    }
    const mtdb::Status status = run(&ok);
    if (!status.ok()) {
      // Whoever reads our pipe has had enough, as `head` has.
      if (status.message().ends_with(std::generic_category().message(EPIPE)) && ReaderIsGone()) {
        return 0;
      }
      PrintError(status.message());
      return kExitError;
    }
  }
  errno = 0;
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    if (errno == EPIPE || ReaderIsGone()) return ok ? 0 : kExitError;
    PrintError("standard output cannot be written; is the disk full?");
    return kExitError;
  }
  return ok ? 0 : kExitError;
}

}  // namespace

// What memory runs out in unwinds, and so leaves nothing behind.
int main(int argc, char** argv) {
  // A store on a full quota or a closed pipe is an error to report, not a reason to die.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  try {
    if (argc == 3 && std::string(argv[1]) == "--write-manual") {
      return CommandLine().WriteManual(argv[2]);
    }
    return CommandLine().Run(argc, argv);
  } catch (const std::bad_alloc&) {
    std::fputs("mtdb: out of memory\n", stderr);
    return kExitError;
  }
}
