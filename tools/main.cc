// mtdb: the command line. Exit status 0 success, 1 error, 2 usage: a command line that no store
// and no file could make right.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "tools/internal/arguments.h"
#include "tools/internal/verbs.h"

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

void AddQueryOptions(CLI::App* verb, mtdb::QueryArguments* a) {
  AddName(verb, &a->name, "which object; needed when the store has several");
  auto* full =
      verb->add_flag("--full", a->full, "full resolution: the input's triangles (default)");
  auto* error = AddParsed(verb, "--error", "E", &a->error, mtdb::ParseNonNegative,
                          "coarser: within E of the surface, in model units");
  auto* relative = AddParsed(verb, "--error-rel", "F", &a->error_relative, mtdb::ParseNonNegative,
                             "the same as a fraction of the bounding box's diagonal");
  auto* triangles = AddParsed(verb, "--triangles", "N", &a->triangles, mtdb::ParseCount,
                              "at most N triangles, as accurate as they allow");
  AddParsed(verb, "--max-bytes", "SIZE", &a->max_bytes, mtdb::ParseSize,
            "read at most SIZE of the store's clusters, as accurate as they allow");
  AddParsed(verb, "--max-ms", "MS", &a->max_ms, mtdb::ParseNonNegative,
            "stop refining after MS milliseconds");
  full->excludes(error)->excludes(relative)->excludes(triangles);
  error->excludes(relative);
  AddParsed(verb, "--box", "X0,Y0,Z0,X1,Y1,Z1", &a->box, mtdb::ParseBox,
            "the region that needs this accuracy, by two corners; elsewhere as coarse as possible");
  AddParsed(verb, "--sphere", "X,Y,Z,R", &a->sphere, mtdb::ParseSphere,
            "a region, by centre and radius; with --box, both together");
  verb->add_flag("--clip", a->clip, "leave out the triangles that do not meet the region");
  AddJson(verb, &a->json);
  // Called when the verb's arguments are complete.
  verb->callback([a] {
    if (a->clip && !a->box && !a->sphere) {
      throw CLI::ValidationError("--clip", "needs a region: give --box or --sphere");
    }
  });
}

void AddIngest(CLI::App* verb, std::vector<std::string>* paths, mtdb::IngestArguments* a) {
  verb->add_option("INPUT... STORE", *paths,
                   "mesh files (.ply .obj .stl .off; several become one object), then the store, "
                   "which is made when it is not there")
      ->required()
      ->expected(2, 1 << 20);
  AddName(verb, &a->name, "the object's name (default: INPUT without folders and extension)");
  auto* bits = verb->add_option("--bits", a->bits,
                                "round positions to a grid of 2^N cells along the longest side, "
                                "N from 1 to 24")
                   ->type_name("N")
                   ->check(CLI::Range(1, 24))
                   ->capture_default_str();
  auto* step = AddParsed(verb, "--step", "S", &a->step, mtdb::ParsePositive,
                         "round positions to multiples of S model units instead");
  auto* lossless = verb->add_flag("--lossless", a->lossless, "keep float32 positions bit for bit");
  bits->excludes(step)->excludes(lossless);
  step->excludes(lossless);
  verb->add_option("--threads", a->threads, "use N threads (default: one per core)")
      ->type_name("N")
      ->check(CLI::Range(1, 1024));
  AddParsed(verb, "--memory", "SIZE", &a->memory_bytes, mtdb::ParseSize,
            "use at most so much memory, the rest goes to temporary files, e.g. 1G; at least 256M "
            "(default: a quarter of the machine's)");
  verb->add_option("--tmp", a->tmp, "folder of temporary files (default: the store's)")
      ->type_name("DIR");
  verb->add_flag("--resume", a->resume, "go on where an interrupted ingest of this input stopped");
  verb->add_flag("--force", a->force, "replace an object of that name");
  verb->add_flag("--quiet", a->quiet, "print nothing but errors");
  AddJson(verb, &a->json);
}

// One line, whatever names of files and objects are in it.
void PrintError(std::string message) {
  for (char& c : message) {
    if (static_cast<unsigned char>(c) < ' ') c = '?';
  }
  std::fprintf(stderr, "mtdb: %s\n", message.c_str());
}

int Usage(const std::string& problem, const std::string& verb) {
  PrintError(problem + "; see 'mtdb help" + (verb.empty() ? "" : " ") + verb + "'");
  return kExitUsage;
}

}  // namespace

int main(int argc, char** argv) {
  // A store on a full quota or a closed pipe is an error to report, not a reason to die.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);

  CLI::App app{"mtdb: an out-of-core database of triangle meshes"};
  app.name("mtdb");
  app.formatter(std::make_shared<HelpFormatter>());
  app.get_formatter()->label("SUBCOMMAND", "VERB");
  app.get_formatter()->label("Positionals", "Arguments");
  app.set_help_flag("-h,--help", "print this and exit");
  app.set_version_flag("--version", std::string("mtdb ") + MTDB_VERSION, "print the version");
  app.require_subcommand(1);
  app.footer(
      "'mtdb help VERB' explains a verb and its options.\n"
      "Exit status: 0 success, 1 error, 2 wrong usage.");
  const auto add_verb = [&](const char* name, const char* description, const char* footer) {
    CLI::App* verb = app.add_subcommand(name, description);
    verb->group("Verbs");
    verb->footer(footer);
    return verb;
  };

  mtdb::IngestArguments ingest;
  std::vector<std::string> paths;
  CLI::App* ingest_verb =
      add_verb("ingest", "store a mesh at every level of detail",
               "Example: mtdb ingest scan.ply scans.mtdb --name statue --bits 18");
  AddIngest(ingest_verb, &paths, &ingest);

  mtdb::InspectArguments inspect;
  CLI::App* info_verb = add_verb("info", "tell what a store holds, in detail", "");
  CLI::App* list_verb = add_verb("list", "list the objects of a store", "");

  mtdb::QueryArguments query;
  CLI::App* extract_verb =
      add_verb("extract", "write the mesh of a region at an accuracy",
               "Example: mtdb extract scans.mtdb head.ply --error 0.5 --sphere 0,0,180,60 --clip");
  extract_verb->add_option("STORE", query.store, "the store file")->required();
  extract_verb->add_option("OUTPUT", query.output, "the mesh file: .ply .obj .stl .off .drc")
      ->required();
  AddQueryOptions(extract_verb, &query);
  extract_verb->add_flag("--normals", query.normals, "add the mesh's normals to its vertices");

  CLI::App* verify_verb = add_verb("verify", "check a store's bytes and meshes", "");
  for (CLI::App* verb : {info_verb, list_verb, verify_verb}) {
    verb->add_option("STORE", inspect.store, "the store file")->required();
    if (verb != list_verb) AddName(verb, &inspect.name, "this object only");
    AddJson(verb, &inspect.json);
  }
  verify_verb
      ->add_option("--level", inspect.level,
                   "fast: pages, checksums, index, digests; full: also decodes every cluster; "
                   "global: also rebuilds the whole surface and compares it with what was ingested")
      ->type_name("LEVEL")
      ->check(CLI::IsMember({"fast", "full", "global"}))
      ->capture_default_str();

  CLI::App* render_verb =
      add_verb("render", "draw what extract would write",
               "Example: mtdb render scans.mtdb coarse.png --error-rel 0.002 --wireframe");
  render_verb->add_option("STORE", query.store, "the store file")->required();
  render_verb->add_option("OUT.png", query.output, "the picture")->required();
  AddQueryOptions(render_verb, &query);
  AddParsed(render_verb, "--size", "WxH", &query.size, mtdb::ParseExtent,
            "width and height in pixels")
      ->default_str("1200x900");
  render_verb->add_flag("--wireframe", query.wireframe, "draw the edges of the triangles");

  CLI::App* remove_verb = add_verb("remove", "remove an object from a store", "");
  remove_verb->add_option("STORE", inspect.store, "the store file")->required();
  remove_verb->add_option("NAME", inspect.name, "the object")->required();

  mtdb::GenerateArguments generate;
  CLI::App* generate_verb =
      add_verb("generate", "make a mesh to try things on",
               "Example: mtdb generate sculpture try.ply --triangles 1000000");
  generate_verb
      ->add_option("SHAPE", generate.shape,
                   "sculpture (closed, with handles and bumps of all sizes) or terrain (a height "
                   "field)")
      ->required()
      ->check(CLI::IsMember({"sculpture", "terrain"}));
  generate_verb->add_option("OUTPUT", generate.output, "the mesh file, binary PLY")->required();
  generate_verb
      ->add_option("--triangles", generate.triangles,
                   "about N triangles, from 100 to 20000000000; required")
      ->required()
      ->type_name("N")
      ->check(CLI::Range(uint64_t{100}, uint64_t{20'000'000'000}));
  generate_verb->add_option("--seed", generate.seed, "another number, another shape")
      ->type_name("S")
      ->capture_default_str();

  std::vector<std::string> arguments(argv + 1, argv + argc);
  if (arguments.empty()) {
    std::fprintf(stderr, "%s", app.help().c_str());
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
    if (app.get_option_no_throw(first) == nullptr) return Usage("no option '" + first + "'", "");
  } else if (app.get_subcommands(is_named).empty()) {
    return Usage("no verb '" + first + "'", "");
  }
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::Success& e) {
    return app.exit(e);
  } catch (const CLI::ParseError& e) {
    const auto verbs = app.get_subcommands();
    return Usage(e.what(), verbs.empty() ? "" : verbs[0]->get_name());
  }

  mtdb::Status status;
  bool ok = true;
  if (ingest_verb->parsed()) {
    ingest.store = paths.back();
    ingest.inputs.assign(paths.begin(), paths.end() - 1);
    status = mtdb::Ingest(ingest);
  } else if (info_verb->parsed()) {
    status = mtdb::Info(inspect);
  } else if (list_verb->parsed()) {
    status = mtdb::List(inspect);
  } else if (verify_verb->parsed()) {
    status = mtdb::Verify(inspect, &ok);
  } else if (remove_verb->parsed()) {
    status = mtdb::Remove(inspect);
  } else if (extract_verb->parsed()) {
    status = mtdb::ExtractVerb(query);
  } else if (render_verb->parsed()) {
    status = mtdb::RenderVerb(query);
  } else {
    status = mtdb::Generate(generate);
  }
  if (!status.ok()) {
    PrintError(status.message());
    return kExitError;
  }
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    PrintError("standard output cannot be written; is the disk full?");
    return kExitError;
  }
  return ok ? 0 : kExitError;
}
