# ruff: noqa: E501 - the lines are those of other languages
"""Headers of exactly the parts of ros2_control (Jazzy) and rclcpp that the exported controller uses. Stubs: that it compiles against
them says that names, arguments and results are used as here, and nothing about ROS."""

STUBS = {
    "controller_interface/controller_interface.hpp": """
#pragma once
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>
#include "rclcpp/rclcpp.hpp"
namespace hardware_interface {
struct LoanedStateInterface { double value = 0.0; template <typename T = double> std::optional<T> get_optional(unsigned int = 10) const { return value; } };
struct LoanedCommandInterface { double value = 0.0; template <typename T> [[nodiscard]] bool set_value(const T & v, unsigned int = 10) { value = v; return true; } };
}
namespace controller_interface {
enum class CallbackReturn : unsigned char { SUCCESS, FAILURE, ERROR };
enum class return_type : unsigned char { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration { interface_configuration_type type; std::vector<std::string> names = {}; };
class ControllerInterface {
public:
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
  virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() const { return node; }
  unsigned int get_update_rate() const { return rate; }
  template <typename T> T auto_declare(const std::string & name, const T & value) { node->put(name, value); return value; }
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node = std::make_shared<rclcpp_lifecycle::LifecycleNode>();
  unsigned int rate = 0;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
};
}
""",
    "rclcpp/rclcpp.hpp": """
#pragma once
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>
#define RCLCPP_ERROR(logger, ...) ((void)(logger), std::printf(__VA_ARGS__), std::printf("\\n"))
#define RCLCPP_WARN RCLCPP_ERROR
#define RCLCPP_INFO RCLCPP_ERROR
namespace rclcpp {
struct Time { double at; double seconds() const { return at; } };
struct Duration { double lasts; };
struct Parameter {
  std::vector<std::string> names; bool yes = false; double number = 0.0;
  std::vector<std::string> as_string_array() const { return names; }
  bool as_bool() const { return yes; }
  double as_double() const { return number; }
};
template <typename T> struct Service { std::function<void(std::shared_ptr<typename T::Request>, std::shared_ptr<typename T::Response>)> call; };
}
namespace rclcpp_lifecycle {
struct State {};
struct LifecycleNode {
  std::map<std::string, rclcpp::Parameter> parameters;
  std::shared_ptr<void> service;
  void put(const std::string & n, const std::vector<std::string> & v) { parameters[n].names = v; }
  void put(const std::string & n, bool v) { parameters[n].yes = v; }
  void put(const std::string & n, double v) { parameters[n].number = v; }
  rclcpp::Parameter get_parameter(const std::string & n) const { return parameters.at(n); }
  int get_logger() const { return 0; }
  template <typename T, typename F> std::shared_ptr<rclcpp::Service<T>> create_service(const std::string &, F && f) {
    auto made = std::make_shared<rclcpp::Service<T>>(); made->call = f; service = made; return made;
  }
};
}
""",
    "std_srvs/srv/trigger.hpp": """
#pragma once
#include <string>
namespace std_srvs::srv { struct Trigger { struct Request {}; struct Response { bool success = false; std::string message; }; }; }
""",
    "pluginlib/class_list_macros.hpp": """
#pragma once
#define PLUGINLIB_EXPORT_CLASS(one, base) base * made_by_pluginlib() { return new one(); }
""",
}

MAIN = """
#include "PACKAGE/PACKAGE.hpp"
#include <cstdio>
#include <cmath>
controller_interface::ControllerInterface * made_by_pluginlib();
int main() {
  auto & one = *made_by_pluginlib();
  const rclcpp_lifecycle::State state;
  using R = controller_interface::CallbackReturn;
  if (one.on_init() != R::SUCCESS) return 1;
  if (one.on_configure(state) != R::ERROR) return 2;  // no interfaces were named
  const std::vector<std::string> names(skill_AXES, "x");
  for (auto name : {"position_interfaces", "velocity_interfaces", "force_interfaces", "command_interfaces"}) one.node->put(name, names);
  one.node->put("force_sign", -1.0);
  if (one.on_configure(state) != R::SUCCESS) return 3;
  if (one.state_interface_configuration().names.size() != 3 * skill_AXES || one.command_interface_configuration().names.size() != skill_AXES) return 4;
  one.state_interfaces_.resize(3 * skill_AXES);
  one.command_interfaces_.resize(skill_AXES);
  one.rate = 7;
  if (one.on_activate(state) != R::ERROR) return 5;  // another rate
  one.rate = (unsigned int)std::lround(1.0 / skill_DT);
  if (one.on_activate(state) != R::SUCCESS) return 6;
  for (int n = 0; n < 150; ++n) {
    for (int i = 0; i < skill_AXES; ++i) {
      one.state_interfaces_[i].value = START[i];
      one.state_interfaces_[2 * skill_AXES + i].value = 0.01 * std::sin(1.7 * n) - 0.02 * std::fmax(n - 50.0, 0.0);
    }
    if (one.update({n * skill_DT}, {skill_DT}) != controller_interface::return_type::OK) return 7;
  }
  std::printf("commanded %g\\n", one.command_interfaces_[0].value);
  return one.command_interfaces_[0].value > 0.0 ? 0 : 8;
}
"""
