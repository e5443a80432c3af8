#include "command_line.hpp"

#include <rosbag/exceptions.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cstdio>
#include <iostream>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

po::variables_map parse(int argc, char** argv, const CommandLine& command_line,
                        const po::options_description& options) {
  po::positional_options_description positional;
  positional.add(command_line.positional.c_str(), -1);
  // The library would give an option of several words all words up to the next option, files included.
  const auto join_pair = [&command_line](std::vector<std::string>& arguments) {
    std::vector<po::option> result;
    if (arguments.front() != command_line.pair_option) return result;
    if (arguments.size() < 3) throw po::error(command_line.pair_option + " takes two numbers");
    result.emplace_back(arguments[0].substr(2), std::vector<std::string>{arguments[1] + "," + arguments[2]});
    arguments.erase(arguments.begin(), arguments.begin() + 3);
    return result;
  };
  // Long options only, not abbreviated: so a negative number is a value, and scripts stay valid.
  using style = po::command_line_style::style_t;
  po::variables_map values;
  po::store(po::command_line_parser(argc, argv)
                .options(options)
                .positional(positional)
                .style(style::allow_long | style::long_allow_adjacent | style::long_allow_next)
                .extra_style_parser(join_pair)
                .run(),
            values);
  return values;
}

}  // namespace

std::istream& operator>>(std::istream& in, NumberPair& pair) {
  char comma = 0;
  if (in >> pair.first >> comma >> pair.second && comma != ',') in.setstate(std::ios::failbit);
  return in;
}

int runTool(int argc, char** argv, const CommandLine& command_line,
            const std::function<int(const po::variables_map&)>& body) {
  try {
    po::options_description options = command_line.options;
    options.add_options()("help", "show this text");
    const bool help = std::any_of(argv + 1, argv + argc, [](const char* word) {
      return std::string(word) == "--help" || std::string(word) == "-h";
    });
    if (help) {
      std::cout << "Usage: " << command_line.usage << "\n\n" << command_line.purpose << "\n\n" << options;
      return kExitOk;
    }
    po::variables_map values = parse(argc, argv, command_line, options);
    po::notify(values);
    return body(values);
  } catch (const po::error& error) {
    std::cerr << error.what() << "\nUsage: " << command_line.usage << "  (--help tells more)\n";
    return kExitUsage;
  } catch (const rosbag::BagException& error) {
    std::cerr << "The bag cannot be read or written: " << error.what() << '\n';
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
  }
  return kExitInput;
}

void useJson(YAML::Emitter& out) {
  out.SetStringFormat(YAML::DoubleQuoted);
  out.SetMapFormat(YAML::Flow);
  out.SetSeqFormat(YAML::Flow);
  out.SetDoublePrecision(9);
}

void ProgressBar::show(const std::string& label, double fraction) {
  if (label != label_) {
    finish();
    label_ = label;
    shown_ = -1;
  }
  static const bool terminal = isatty(STDERR_FILENO) == 1;
  const int percent = static_cast<int>(100.0 * std::clamp(fraction, 0.0, 1.0));
  if (percent <= shown_ || (!terminal && shown_ >= 0 && percent / 10 == shown_ / 10)) return;
  shown_ = percent;
  if (terminal) {
    constexpr int kWidth = 40;
    const std::string bar(static_cast<std::size_t>(kWidth * percent / 100), '#');
    std::fprintf(stderr, "\r%-24s [%-*s] %3d %%", label_.c_str(), kWidth, bar.c_str(), percent);
  } else {
    std::fprintf(stderr, "%s: %d %%\n", label_.c_str(), percent);
  }
}

void ProgressBar::finish() {
  if (shown_ >= 0 && isatty(STDERR_FILENO) == 1) std::fputc('\n', stderr);
  shown_ = -1;
  label_.clear();
}

}  // namespace lidar_camera_recalibration
