// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/command_line.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <iostream>
#include <memory>
#include <poll.h>
#include <system_error>
#include <unistd.h>

#include "store/base/redact.h"
#include "tools/cli/did_you_mean.h"
#include "tools/cli/manual.h"
#include "tools/client/printable.h"
#include "tools/request/arguments.h"

namespace mtdb {

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
  HelpFormatter() {
    column_width(kHelpColumn);
    label("SUBCOMMAND", "VERB");
    label("Positionals", "Arguments");
  }
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

// One line, whatever names of files and objects are in it.
void PrintError(const std::string& message) {
  std::fprintf(stderr, "mtdb: %s\n", Printable(WithoutSecrets(message)).c_str());
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
  return "no option '" + name + "'" + DidYouMean(name, known);
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

bool IsGiven(const CLI::App& verb, const char* flag) {
  const CLI::Option* const option = verb.get_option_no_throw(flag);
  return option != nullptr && option->count() > 0;
}

// Whether standard output is a pipe that nobody reads any more. What could not be written may have
// been lost long ago, and errno with it.
bool ReaderIsGone() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) > 0 && (out.revents & (POLLERR | POLLHUP)) != 0;
}

}  // namespace

CommandLine::CommandLine(std::span<const Verb* const> verbs, const std::string& version)
    : version_(version) {
  app_.name("mtdb");
  app_.formatter(std::make_shared<HelpFormatter>());
  app_.set_help_flag("-h,--help", "print this and exit");
  app_.set_version_flag("--version", "mtdb " + version, "print the version");
  app_.require_subcommand(1);
  app_.footer(
      "'mtdb help VERB' explains a verb and its options.\n"
      "Exit status: 0 success, 1 error, 2 wrong usage.");
  for (const Verb* const verb : verbs) {
    CLI::App* const added = app_.add_subcommand(verb->name, verb->summary);
    added->group("Verbs");
    added->footer(verb->footer);
    added->add_flag("--quiet")->description(
        "print nothing but errors, and JSON where it is asked for");
    VerbOptions options(added);
    verbs_.emplace_back(added, verb->add(&options));
  }
}

namespace {

int CannotWrite() {
  PrintError("standard output cannot be written; is the disk full?");
  return kExitError;
}

}  // namespace

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
    return Usage("no verb '" + first + "'" + DidYouMean(first, known), "");
  }
  try {
    app_.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::Success& e) {
    const int exit_status = app_.exit(e);
    errno = 0;
    if (std::cout.flush()) return exit_status;
    return errno == EPIPE || ReaderIsGone() ? exit_status : CannotWrite();
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

int CommandLine::RunParsed(const CLI::App& verb, const RunVerb& run, const std::string& command) {
  Invocation invocation{command, IsGiven(verb, "--quiet") && !IsGiven(verb, "--json")};
  // A mesh goes by the descriptor, and so still to standard output.
  if (invocation.quiet) {
    if (std::FILE* const nothing = std::fopen("/dev/null", "w")) stdout = nothing;
  }
  const Status status = run(invocation);
  if (!status.ok()) {
    // Whoever reads our pipe has had enough, as `head` has.
    if (status.message().ends_with(std::generic_category().message(EPIPE)) && ReaderIsGone()) {
      return 0;
    }
    PrintError(status.message());
    return kExitError;
  }
  const int exit_status = invocation.failed ? kExitError : invocation.exit_status;
  errno = 0;
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    if (errno == EPIPE || ReaderIsGone()) return exit_status;
    return CannotWrite();
  }
  return exit_status;
}

int CommandLine::Run(const std::vector<std::string>& arguments) {
  if (arguments.size() == 2 && arguments[0] == "--write-manual") {
    const Status status = WriteManual(app_, version_, arguments[1]);
    if (!status.ok()) PrintError(status.message());
    return status.ok() ? 0 : kExitError;
  }
  if (const auto exit_status = Parse(arguments)) return *exit_status;
  std::string command = "mtdb";
  for (const std::string& argument : arguments) command += " " + QuoteForShell(argument);
  const auto parsed = std::ranges::find_if(verbs_, [](const auto& v) { return v.first->parsed(); });
  return RunParsed(*parsed->first, parsed->second, command);
}

}  // namespace mtdb
