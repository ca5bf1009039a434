// mtdb: the command line. Exit status 0 success, 1 error, 2 usage: a command line that no store
// and no file could make right.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "query/query_json.h"
#include "store/object_name.h"
#include "tools/cli/follow_path.h"
#include "tools/cli/verbs.h"
#include "tools/client/client.h"
#include "tools/client/printable.h"
#include "tools/request/arguments.h"
#include "tools/request/query_options.h"

namespace {

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

// An option whose text `parse` turns into a value; a text that it refuses is a usage error.
template <typename Value, typename Parse>
CLI::Option* AddParsed(CLI::App* verb, const std::string& name, const std::string& form,
                       Value* value, Parse parse, const std::string& description) {
  return verb
      ->add_option_function<std::string>(
          name,
          [=](const std::string& text) {
            auto result = parse(text);
            if (!result.ok()) throw CLI::ValidationError(name, result.status().message());
            *value = *std::move(result);
          },
          description)
      ->type_name(form);
}

void AddName(CLI::App* verb, std::string* name, const char* description) {
  verb->add_option("--name", *name, description)->type_name("NAME");
}

void AddJson(CLI::App* verb, bool* json) {
  verb->add_flag("--json", *json, "print the result as JSON");
}

// An option that may be given several times.
template <typename List, typename Parse>
CLI::Option* AddParsedList(CLI::App* verb, const std::string& name, const std::string& form,
                           List* values, Parse parse, const std::string& description) {
  return verb
      ->add_option_function<std::vector<std::string>>(
          name,
          [=](const std::vector<std::string>& texts) {
            for (const std::string& text : texts) {
              auto result = parse(text);
              if (!result.ok()) throw CLI::ValidationError(name, result.status().message());
              values->push_back(*std::move(result));
            }
          },
          description)
      ->type_name(form)
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
}

void AddAccuracyOptions(CLI::App* verb, mtdb::QueryOptions* q) {
  const char* group = "How accurate (several: all must hold)";
  auto* full =
      verb->add_flag("--full", q->full, "full resolution: the input's triangles (default)");
  auto* error = AddParsed(verb, "--error", "E", &q->error, mtdb::ParseNonNegative,
                          "coarser: within E of the surface, in model units");
  auto* relative = AddParsed(verb, "--error-rel", "F", &q->error_relative, mtdb::ParseNonNegative,
                             "the same as a fraction of the bounding box's diagonal");
  auto* pixels = AddParsed(verb, "--pixels", "P", &q->pixels, mtdb::ParsePositive,
                           "what the camera sees is off by at most P pixels");
  auto* at = AddParsedList(
      verb, "--error-at", "LAW,X,Y,Z,BASE,F", &q->errors_at, mtdb::ErrorAtOption,
      "by the distance r from a point; LAW is linear (BASE + F r), quadratic (BASE + F r^2), sqrt "
      "(BASE + F sqrt r) or exp (BASE exp(F r))");
  auto* outside = AddParsed(verb, "--error-outside", "E", &q->error_outside, mtdb::ParseNonNegative,
                            "within E outside of the region too, not as coarse as possible");
  auto* triangles = AddParsed(verb, "--triangles", "N", &q->triangles, mtdb::ParseCount,
                              "at most N triangles, as accurate as they allow");
  auto* bytes = AddParsed(verb, "--max-bytes", "SIZE", &q->max_bytes, mtdb::ParseSize,
                          "read at most SIZE of the store's clusters, as accurate as they allow");
  auto* time = AddParsed(verb, "--max-ms", "MS", &q->max_ms, mtdb::ParseNonNegative,
                         "stop refining after MS milliseconds");
  for (auto* option : {error, relative, pixels, at, triangles}) full->excludes(option);
  error->excludes(relative);
  for (auto* option : {full, error, relative, pixels, at, outside, triangles, bytes, time}) {
    option->group(group);
  }
}

void AddRegionOptions(CLI::App* verb, mtdb::QueryOptions* q) {
  const char* group = "Where (several: in any of them; elsewhere as coarse as possible)";
  const auto add = [&](const char* name, const char* form, auto parse, const char* description) {
    AddParsedList(verb, name, form, &q->regions, parse, description)->group(group);
  };
  add("--box", "X0,Y0,Z0,X1,Y1,Z1", mtdb::BoxOption, "a box, by two corners");
  add("--sphere", "X,Y,Z,R", mtdb::SphereOption, "a ball, by centre and radius");
  add("--half-space", "X,Y,Z,NX,NY,NZ", mtdb::HalfSpaceOption,
      "what is behind the plane through X,Y,Z that faces NX,NY,NZ");
  add("--prism", "X0,Y0,X1,Y1,...", mtdb::PrismOption, "above and below a polygon");
  add("--wedge", "X,Y,DX,DY,ANGLE[,FAR]", mtdb::WedgeOption,
      "above and below a wedge at X,Y that looks along DX,DY, ANGLE degrees wide");
  add("--point", "X,Y,Z", mtdb::PointRegionOption, "a point");
  add("--segment", "X0,Y0,Z0,X1,Y1,Z1", mtdb::SegmentOption, "a segment: a line of sight");
  add("--tube", "R,X0,Y0,Z0,X1,Y1,Z1,...", mtdb::TubeOption,
      "what is within R of a line through points");
  verb->add_flag("--frustum", q->frustum, "what the camera sees")->group(group);
  verb->add_flag("--intersect", q->intersect, "what lies in all of the regions, not in any")
      ->group(group);
  verb->add_flag("--outside", q->outside, "what lies outside of all that")->group(group);
  verb->add_flag("--clip", q->clip, "leave out the triangles that do not meet the region")
      ->group(group);
}

void AddCameraOptions(CLI::App* verb, mtdb::QueryOptions* q) {
  const char* group = "The camera";
  const auto add = [&](const char* name, const char* form, auto* value, auto parse,
                       const char* description) {
    AddParsed(verb, name, form, value, parse, description)->group(group);
  };
  add("--eye", "X,Y,Z", &q->eye, mtdb::PointOption, "where it is");
  add("--target", "X,Y,Z", &q->target, mtdb::PointOption, "what it looks at");
  add("--up", "X,Y,Z", &q->up, mtdb::PointOption, "what is up in its picture (default: 0,0,1)");
  add("--fov", "DEGREES", &q->fov, mtdb::ParsePositive,
      "the angle from the bottom to the top of its picture (default: 45)");
  add("--viewport", "WxH", &q->viewport, mtdb::ParseExtent,
      "its picture's size in pixels (default: 1200x900; render: --size)");
}

void AddQueryOptions(CLI::App* verb, mtdb::QueryArguments* a, bool draws) {
  AddName(verb, &a->name, "which object; needed when the store has several");
  AddAccuracyOptions(verb, &a->query);
  AddRegionOptions(verb, &a->query);
  AddCameraOptions(verb, &a->query);
  verb->add_option("--query", a->query.file,
                   "region and threshold from a JSON file (docs/query.md), or - for standard "
                   "input: all that "
                   "the options below say, and more")
      ->type_name("FILE");
  verb->add_flag("--print-query", a->print_query,
                 "print the query as JSON, for --query, and do nothing else");
  AddJson(verb, &a->json);
  // Called when the verb's arguments are complete.
  verb->callback([a, draws] {
    mtdb::Status status = mtdb::CheckOptions(a->query, draws);
    // A query of options alone depends on nothing else; of the object's size only by a factor.
    if (status.ok() && a->query.file.empty()) {
      const auto json = mtdb::QueryOf(a->query, a->size);
      status = json.ok() ? mtdb::ParseQuery(json->dump(), 1).status() : json.status();
    }
    if (!status.ok()) throw CLI::ValidationError(status.message());
  });
}

void AddImplicit(CLI::App* verb, bool* implicit) {
  verb->add_flag("--implicit", *implicit,
                 "keep clusters in memory as in the store, some 30 times smaller than decoded, and "
                 "decode what a query needs each time anew; the answers are the same");
}

void AddServe(CLI::App* verb, mtdb::ServerOptions* o) {
  verb->add_option("STORE", o->service.store, "the store file, or a packed file or its URL")
      ->required();
  const auto number = [&](const char* name, auto* value, auto smallest, auto largest,
                          const char* description) {
    return verb->add_option(name, *value, description)
        ->type_name("N")
        ->check(CLI::Range(smallest, largest));
  };
  AddParsed(verb, "--listen", "WHERE", &o->listen, mtdb::ParseEndpoint,
            "ADDRESS:PORT, or PORT on 127.0.0.1; port 0 is any free one. Whoever can connect can "
            "read the whole store: there are no passwords")
      ->default_str("127.0.0.1:8080");
  number("--threads", &o->threads, 1, 1024, "answer N queries at once (default: one per core)");
  AddParsed(verb, "--cache", "SIZE", &o->service.cache_bytes, mtdb::ParseSize,
            "keep decoded clusters of so much memory for each open object")
      ->default_str("256M");
  AddImplicit(verb, &o->service.implicit);
  number("--max-objects", &o->service.objects, 1, 10000, "keep the last N objects open")
      ->capture_default_str();
  number("--max-connections", &o->max_connections, 1, 100000,
         "take at most N connections; others are told to try again")
      ->capture_default_str();
  number("--max-sessions", &o->max_sessions, 1, 100000,
         "open at most N sessions among them; others are told to try again")
      ->capture_default_str();
  AddParsed(verb, "--max-triangles", "N", &o->service.max_triangles, mtdb::ParseCount,
            "send no mesh of more triangles")
      ->default_str("20000000");
  AddParsed(verb, "--session-triangles", "N", &o->service.session_triangles, mtdb::ParseCount,
            "let no session's mesh have more triangles; each takes some 250 to 700 bytes here")
      ->default_str("1000000");
  AddParsed(verb, "--session-memory", "SIZE", &o->service.session_memory_bytes, mtdb::ParseSize,
            "let all sessions together take so much memory; then the largest give way")
      ->default_str("2G");
  AddParsed(verb, "--max-tmp", "SIZE", &o->service.temporary_bytes, mtdb::ParseSize,
            "let all answers under way take so much of temporary files; then the largest give way")
      ->default_str("4G");
  AddParsed(verb, "--idle", "SECONDS", &o->idle_seconds, mtdb::ParsePositiveSeconds,
            "close a connection that is silent for so long")
      ->default_str("30");
  AddParsed(verb, "--session-idle", "SECONDS", &o->session_idle_seconds, mtdb::ParsePositiveSeconds,
            "close a session whose client has said nothing for so long, nor answered a ping")
      ->default_str("300");
  AddParsed(verb, "--timeout", "SECONDS", &o->timeout_seconds, mtdb::ParsePositiveSeconds,
            "give up a request that takes longer, its sending included")
      ->default_str("600");
  AddParsed(verb, "--grace", "SECONDS", &o->grace_seconds, mtdb::ParseSeconds,
            "when told to stop, let running requests finish for so long")
      ->default_str("5");
  verb->add_option("--allow-origin", o->allowed_origin,
                   "let web pages of this origin open sessions, e.g. http://localhost:3000; * is "
                   "any (default: those that come from the server's own address only)")
      ->type_name("ORIGIN");
  verb->add_option("--allow-host", o->allowed_hosts,
                   "let clients call the server by this name, e.g. scans.example.org; * is any "
                   "(default: by address and localhost only)")
      ->type_name("NAME");
  verb->add_option("--tmp", o->service.tmp, "folder of temporary files (default: the system's)")
      ->type_name("DIR");
}

void AddOutput(CLI::App* verb, std::string* output) {
  verb->add_option("OUTPUT", *output,
                   "the mesh file: " + mtdb::SuffixesOf(mtdb::WrittenMeshFormats()))
      ->required()
      ->check([](const std::string& text) {
        return mtdb::WrittenMeshFormatOf(text).status().message();
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

void AddProbe(CLI::App* verb, mtdb::ProbeArguments* a) {
  verb->add_option("STORE", a->store, "the store file")->required();
  AddName(verb, &a->name, "which object; needed when the store has several");
  auto* point = AddParsed(verb, "--point", "X,Y,Z", &a->point, mtdb::ParsePoint,
                          "find the closest point of the surface to this one");
  AddParsed(verb, "--ray", "X,Y,Z,DX,DY,DZ", &a->ray, mtdb::ParseRay,
            "find where this ray, of origin and direction, first meets the surface")
      ->excludes(point);
  AddParsed(verb, "--error", "E", &a->error, mtdb::ParseNonNegative,
            "on a surface within E of the input, in model units (default: full resolution)");
  AddParsed(verb, "--limit", "D", &a->limit, mtdb::ParseNonNegative,
            "look no farther: a distance, or for rays a multiple of the direction");
  AddJson(verb, &a->json);
  verb->callback([a] {
    if (!a->point && !a->ray) throw CLI::ValidationError("probe", "give --point or --ray");
  });
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
                       "object), then the store, which is made when it is not there")
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
  verb->add_option("--normals", a->normal_bits,
                   "keep of normals (nx, ny, nz) the direction only, in N bits a component, N from "
                   "4 to 16, e.g. 10 (default: lossless)")
      ->type_name("N")
      ->check(CLI::Range(4, 16));
  AddParsedList(
      verb, "--attribute", "NAME=STEP", &a->attribute_steps, mtdb::ParseAttributeStep,
      "round a float attribute to multiples of a step (default: lossless); may be repeated");
  verb->add_option("--threads", a->threads, "use N threads (default: one per core)")
      ->type_name("N")
      ->check(CLI::Range(1, 1024));
  AddParsed(verb, "--memory", "SIZE", &a->memory_bytes, mtdb::ParseMemory,
            "use at most so much memory, the rest goes to temporary files, e.g. 1G; at least 256M "
            "(default: a quarter of the machine's)");
  verb->add_option("--tmp", a->tmp, "folder of temporary files (default: the store's)")
      ->type_name("DIR");
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
  std::fprintf(stderr, "mtdb: %s\n", mtdb::Printable(message).c_str());
}

int Usage(const std::string& problem, const std::string& verb) {
  PrintError(problem + "; see 'mtdb help" + (verb.empty() ? "" : " ") + verb + "'");
  return kExitUsage;
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

// The verbs, what their options fill, and what each runs.
class CommandLine {
 public:
  CommandLine();
  int Run(int argc, char** argv);

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
  void AddFollowVerb();
  void AddRemoveVerb();
  void AddPackVerbs();
  void AddGenerateVerb();
  // Exit status where the arguments ask for nothing that is to be run.
  std::optional<int> Parse(std::vector<std::string> arguments);

  CLI::App app_{"mtdb: an out-of-core database of triangle meshes"};
  std::vector<std::pair<const CLI::App*, Verb>> verbs_;
  std::vector<std::string> paths_;  // of ingest
  mtdb::IngestArguments ingest_;
  mtdb::InspectArguments inspect_;
  mtdb::PackArguments pack_;
  mtdb::QueryArguments query_;
  mtdb::ProbeArguments probe_;
  mtdb::ServerOptions serve_;
  mtdb::ViewArguments view_;
  mtdb::FollowArguments follow_;
  mtdb::GenerateArguments generate_;
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
  AddProbe(AddVerb("probe", "find the closest point of a surface, or the first hit of a ray",
                   "Example: mtdb probe scans.mtdb --ray 0,0,500,0,0,-1 --error 0.5",
                   [this](bool*) { return mtdb::Probe(probe_); }),
           &probe_);
  AddServerVerbs();
  AddFollowVerb();
  AddRemoveVerb();
  AddPackVerbs();
  AddGenerateVerb();
}

CLI::App* CommandLine::AddVerb(const char* name, const char* description, const char* footer,
                               Verb run) {
  CLI::App* verb = app_.add_subcommand(name, description);
  verb->group("Verbs");
  verb->footer(footer);
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
  verb->callback([this] {
    const auto count = std::count(paths_.begin(), paths_.end() - 1, "-");
    if (count > 1) throw CLI::ValidationError("-", "standard input can be read once");
    if (paths_.front() == "-" && ingest_.name.empty() && !ingest_.dry_run) {
      throw CLI::ValidationError("-", "standard input has no name: give the object one by --name");
    }
    if (count == 0 && !ingest_.format.empty()) {
      throw CLI::ValidationError("--format", "goes with - only; files are known by their names");
    }
    if (count == 1 && ingest_.resume) {
      throw CLI::ValidationError("--resume", "cannot read standard input again; copy it to a file");
    }
  });
}

void AddStore(CLI::App* verb, std::string* store) {
  verb->add_option("STORE", *store, "the store file, or a packed file or its URL")->required();
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
  verb->add_flag("--normals", query->query.normals, "add the mesh's normals to its vertices");
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
  AddOutput(verb, &query_.output);
  AddQueryOptions(verb, &query_, false);
  AddImplicit(verb, &query_.implicit);
  AddNormals(verb, &query_);
}

void CommandLine::AddVerifyVerb() {
  CLI::App* verb = AddVerb("verify", "check a store's bytes and meshes", "",
                           [this](bool* ok) { return mtdb::Verify(inspect_, ok); });
  AddStore(verb, &inspect_.store);
  AddName(verb, &inspect_.name, "this object only");
  AddJson(verb, &inspect_.json);
  verb->add_option("--level", inspect_.level,
                   "fast: pages, checksums, index, digests; full: also decodes every cluster; "
                   "global: also rebuilds the whole surface and compares it with what was ingested")
      ->type_name("LEVEL")
      ->check(CLI::IsMember({"fast", "full", "global"}))
      ->capture_default_str();
}

void CommandLine::AddRenderVerb() {
  CLI::App* verb =
      AddVerb("render", "draw what extract would write",
              "Example: mtdb render scans.mtdb coarse.png --error-rel 0.002 --wireframe",
              [this](bool*) { return mtdb::RenderVerb(query_); });
  AddStore(verb, &query_.store);
  verb->add_option("OUT.png", query_.output, "the picture")
      ->required()
      ->check([](const std::string& text) {
        return text.ends_with(".png") ? "" : text + ": expected a name that ends in .png";
      });
  AddQueryOptions(verb, &query_, true);
  AddParsed(verb, "--size", "WxH", &query_.size, mtdb::ParseExtent, "width and height in pixels")
      ->default_str("1200x900");
  verb->add_flag("--overview", query_.overview,
                 "draw the whole object as without a camera, not what the camera sees");
  verb->add_flag("--wireframe", query_.wireframe, "draw the edges of the triangles");
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
  CLI::App* view = AddVerb("view", "look at a store's objects in the browser",
                           "Serves STORE on this machine alone, prints the URL, and opens it by "
                           "xdg-open. Ends with SIGINT (Ctrl-C) or SIGTERM.\n"
                           "Example: mtdb view scans.mtdb\n"
                           "To choose limits, or to let others look: mtdb serve, whose URL shows "
                           "the same page",
                           [this](bool*) { return mtdb::View(view_); });
  AddStore(view, &view_.store);
  view->add_option("--port", view_.port, "listen on this port (default: any free one)")
      ->type_name("N")
      ->check(CLI::Range(1, 65535));
  view->add_flag("!--no-browser", view_.browser, "only print the URL");
  CLI::App* fetch =
      AddVerb("fetch", "extract from a server (mtdb serve)",
              "Example: mtdb fetch http://localhost:8080/objects/statue head.ply --error 0.5 "
              "--sphere 0,0,180,60\n"
              "More: docs/query.md, docs/protocol.md",
              [this](bool*) { return mtdb::Fetch(query_); });
  AddUrl(fetch, &query_.store);
  AddOutput(fetch, &query_.output);
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

void CommandLine::AddRemoveVerb() {
  CLI::App* verb = AddVerb("remove", "remove an object from a store", "",
                           [this](bool*) { return mtdb::Remove(inspect_); });
  AddStore(verb, &inspect_.store);
  verb->add_option("NAME", inspect_.name, "the object")->required();
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
  pack->add_option("FILE", pack_.to, "the packed file; one of that name is replaced")->required();
  add_names(pack);
  CLI::App* unpack = AddVerb("unpack", "put a packed file's objects into a store",
                             "Example: mtdb unpack statue.mtdbp scans.mtdb",
                             [this](bool*) { return mtdb::Unpack(pack_); });
  unpack->add_option("FILE", pack_.from, "the packed file, or its URL")->required();
  unpack->add_option("STORE", pack_.to, "the store; made if it is not there")->required();
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
  AddOutput(verb, &generate_.output);
  verb->add_option("--triangles", generate_.triangles,
                   "about N triangles, from 100 to 8300000000 (as far as indices of 32 bits go); "
                   "required")
      ->required()
      ->type_name("N")
      ->check(CLI::Range(uint64_t{100}, uint64_t{8'300'000'000}));
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
    if (app_.get_option_no_throw(first) == nullptr) return Usage("no option '" + first + "'", "");
  } else if (app_.get_subcommands(is_named).empty()) {
    return Usage("no verb '" + first + "'", "");
  }
  try {
    app_.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::Success& e) {
    return app_.exit(e);
  } catch (const CLI::ParseError& e) {
    const auto verbs = app_.get_subcommands();
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
    if (const mtdb::Status status = run(&ok); !status.ok()) {
      PrintError(status.message());
      return kExitError;
    }
  }
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
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
    return CommandLine().Run(argc, argv);
  } catch (const std::bad_alloc&) {
    std::fputs("mtdb: out of memory\n", stderr);
    return kExitError;
  }
}
