// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/manual.h"

#include <vector>

#include "codecs/mesh_file/atomic_file.h"

namespace mtdb {

namespace {

// Text as roff has it: no line begins a command, and nothing is an escape.
std::string Roff(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else if (c == '.' || c == '\'') {
      out += (out.empty() || out.back() == '\n') ? std::string("\\&") + c : std::string(1, c);
    } else {
      out += c;
    }
  }
  return out;
}

std::vector<const CLI::App*> VerbsOf(const CLI::App& program) {
  return program.get_subcommands([](const CLI::App* verb) { return !verb->get_name().empty(); });
}

std::vector<const CLI::Option*> OptionsOf(const CLI::App& app, bool positional) {
  return app.get_options(
      [&](const CLI::Option* option) { return option->get_positional() == positional; });
}

// "--box X0,Y0,...".
std::string Label(const CLI::Option& option) {
  if (option.get_positional()) return option.get_name(true);
  std::string label = option.get_name(false, true);
  if (option.get_type_size() == 0) return label;
  const std::string type = option.get_type_name();
  return label + " " + type.substr(0, type.find(':'));
}

void AddOptions(const CLI::App& app, bool positional, std::string* page) {
  for (const CLI::Option* option : OptionsOf(app, positional)) {
    if (option->get_description().empty()) continue;
    *page += ".TP\n.B " + Roff(Label(*option)) + "\n" + Roff(option->get_description());
    const std::string text = option->get_default_str();
    *page += (text.empty() ? "" : Roff(" (default: " + text + ")")) + "\n";
  }
}

std::string Head(const std::string& name, const std::string& version, const std::string& what) {
  return ".TH " + name + " 1 \"\" \"mtdb " + version + "\" \"mtdb\"\n.SH NAME\n" + Roff(name) +
         " \\- " + Roff(what) + "\n";
}

std::string VerbPage(const CLI::App& verb, const std::string& version) {
  std::string page = Head("mtdb-" + verb.get_name(), version, verb.get_description());
  page += ".SH SYNOPSIS\n.B mtdb " + Roff(verb.get_name()) + "\n";
  for (const CLI::Option* option : OptionsOf(verb, true)) page += Roff(Label(*option)) + "\n";
  page += "[options]\n";
  if (!OptionsOf(verb, true).empty()) page += ".SH ARGUMENTS\n";
  AddOptions(verb, true, &page);
  page += ".SH OPTIONS\n";
  AddOptions(verb, false, &page);
  if (!verb.get_footer().empty())
    page += ".SH EXAMPLES\n.nf\n" + Roff(verb.get_footer()) + "\n.fi\n";
  return page + ".SH SEE ALSO\n.BR mtdb (1)\n";
}

std::string ProgramPage(const CLI::App& program, const std::string& version) {
  std::string page = Head("mtdb", version, "an out-of-core database of triangle meshes");
  page += ".SH SYNOPSIS\n.B mtdb\nVERB [arguments] [options]\n.SH DESCRIPTION\n" +
          Roff(
              "Stores meshes of any size at every level of detail in one file, and gives any "
              "region at any accuracy as the smallest conforming mesh that keeps the error "
              "bound.") +
          "\n.SH VERBS\n";
  std::string also;
  for (const CLI::App* each : VerbsOf(program)) {
    page += ".TP\n.B " + Roff(each->get_name()) + "\n" + Roff(each->get_description()) + "\n";
    also += (also.empty() ? "" : " ,\n") + std::string(".BR mtdb\\-") + each->get_name() + " (1)";
  }
  page += ".SH OPTIONS\n";
  AddOptions(program, false, &page);
  page += ".SH EXIT STATUS\n0 success, 1 error, 2 wrong usage.\n.SH SEE ALSO\n";
  return page + also + "\n";
}

std::string BashCompletion(const CLI::App& program) {
  std::string verbs;
  std::string cases;
  for (const CLI::App* verb : VerbsOf(program)) {
    verbs += (verbs.empty() ? "" : " ") + verb->get_name();
    std::string options;
    for (const CLI::Option* option : OptionsOf(*verb, false)) {
      for (const std::string& name : option->get_lnames()) options += " --" + name;
    }
    cases += "    " + verb->get_name() + ") words=\"" + options.substr(options.empty() ? 0 : 1) +
             "\" ;;\n";
  }
  return "# Completes the verbs and options of mtdb, and names of files. Made by mtdb.\n"
         "_mtdb() {\n"
         "  local word=${COMP_WORDS[COMP_CWORD]} words=\n"
         "  COMPREPLY=()\n"
         "  if ((COMP_CWORD == 1)); then\n"
         "    COMPREPLY=($(compgen -W \"" +
         verbs +
         " help --help --version\" -- \"$word\"))\n"
         "    return\n"
         "  fi\n"
         "  case ${COMP_WORDS[1]} in\n"
         "    help) COMPREPLY=($(compgen -W \"" +
         verbs + "\" -- \"$word\")); return ;;\n" + cases +
         "  esac\n"
         "  if [[ $word == -* ]]; then\n"
         "    COMPREPLY=($(compgen -W \"$words\" -- \"$word\"))\n"
         "  else\n"
         "    COMPREPLY=($(compgen -f -- \"$word\"))\n"
         "  fi\n"
         "}\n"
         "complete -o filenames -F _mtdb mtdb\n";
}

Status WriteText(const std::string& path, const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const auto file, AtomicFile::Create(path));
  MTDB_RETURN_IF_ERROR(file->Append(text));
  return file->Commit();
}

}  // namespace

Status WriteManual(const CLI::App& program, const std::string& version, const std::string& folder) {
  MTDB_RETURN_IF_ERROR(WriteText(folder + "/mtdb.1", ProgramPage(program, version)));
  for (const CLI::App* verb : VerbsOf(program)) {
    MTDB_RETURN_IF_ERROR(
        WriteText(folder + "/mtdb-" + verb->get_name() + ".1", VerbPage(*verb, version)));
  }
  return WriteText(folder + "/mtdb.bash", BashCompletion(program));
}

}  // namespace mtdb
