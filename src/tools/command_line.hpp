#pragma once

#include <boost/program_options.hpp>
#include <functional>
#include <istream>
#include <limits>
#include <sstream>
#include <string>

namespace YAML {
class Emitter;
}

namespace lidar_camera_recalibration {

// Exit statuses of all tools.
constexpr int kExitOk = 0;
constexpr int kExitInput = 1;     ///< the input cannot be used
constexpr int kExitUsage = 2;     ///< the command line is wrong
constexpr int kExitRejected = 3;  ///< calibrate_bag: a result, but not accepted

/// Value of an option with two numbers.
struct NumberPair {
  double first = 0.0, second = 0.0;
};
std::istream& operator>>(std::istream& in, NumberPair& pair);

struct CommandLine {
  std::string usage;    ///< "tool FILE [options]"
  std::string purpose;  ///< a few sentences
  boost::program_options::options_description options;
  std::string positional;        ///< option that takes the words without a name
  std::string pair_option = "";  ///< `--name` of an option that takes a NumberPair as two words
};

/// Parses, answers --help, runs the body and turns whatever it throws into a message and an exit status.
/// The body reports a wrong use of options by throwing boost::program_options::error.
int runTool(int argc, char** argv, const CommandLine& command_line,
            const std::function<int(const boost::program_options::variables_map&)>& body);

/// A number with limits; `name` is for the message.
template <typename T>
boost::program_options::typed_value<T>* inRange(T minimum, T maximum, T* target, const std::string& name) {
  return boost::program_options::value<T>()->notifier([=](const T& value) {
    if (!(value >= minimum && value <= maximum)) {
      std::ostringstream what;
      what << "--" << name << " " << value << ": must be ";
      if (maximum < std::numeric_limits<T>::max())
        what << minimum << " to " << maximum;
      else
        what << "at least " << minimum;
      throw boost::program_options::error(what.str());
    }
    *target = value;
  });
}

template <typename T>
boost::program_options::typed_value<T>* atLeast(T minimum, T* target, const std::string& name) {
  return inRange(minimum, std::numeric_limits<T>::max(), target, name);
}

/// Makes the emitter write JSON: flow maps with quoted strings are both. Numbers must be finite.
void useJson(YAML::Emitter& out);

/// A progress bar on stderr; a line for each tenth if stderr is no terminal.
class ProgressBar {
 public:
  ~ProgressBar() { finish(); }
  /// A new label finishes the bar before.
  void show(const std::string& label, double fraction);
  void finish();

 private:
  std::string label_;
  int shown_ = -1;
};

}  // namespace lidar_camera_recalibration
