"""The package that `--to ros2-control` writes: a controller for ros2_control of Jazzy or later, with the exported C inside."""

HPP = """\
// made by comanip; do not edit: export again
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "std_srvs/srv/trigger.hpp"

#include <atomic>

extern "C" {
#include "skill.h"
}

namespace @PACKAGE@ {

/// Velocity of the hand from what it feels, axis by axis (@AXIS_NAMES@), SI, in the frame of the lessons.
class @CLASS@ : public controller_interface::ControllerInterface {
public:
  controller_interface::CallbackReturn on_init() override;
  controller_interface::InterfaceConfiguration command_interface_configuration() const override;
  controller_interface::InterfaceConfiguration state_interface_configuration() const override;
  controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State & previous) override;
  controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State & previous) override;
  controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State & previous) override;
  controller_interface::return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) override;

private:
  double read(std::size_t which) const;
  bool command(const double * values);

  std::vector<std::string> positions_, velocities_, forces_, commands_;
  bool commands_positions_ = false;
  double force_sign_ = 1.0;
  skill_state state_;
  int told_ = 0;
  std::atomic<bool> asked_to_rearm_{false};
  std::shared_ptr<rclcpp::Service<std_srvs::srv::Trigger>> rearm_;
};

}  // namespace @PACKAGE@
"""

CPP = """\
// made by comanip; do not edit: export again
#include "@PACKAGE@/@PACKAGE@.hpp"

#include <cmath>
#include <limits>

#include "pluginlib/class_list_macros.hpp"

namespace @PACKAGE@ {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

CallbackReturn @CLASS@::on_init() {
  const std::vector<std::string> none;
  auto_declare<std::vector<std::string>>("position_interfaces", none);
  auto_declare<std::vector<std::string>>("velocity_interfaces", none);
  auto_declare<std::vector<std::string>>("force_interfaces", none);
  auto_declare<std::vector<std::string>>("command_interfaces", none);
  auto_declare<bool>("commands_positions", false);
  auto_declare<double>("force_sign", 1.0);
  return CallbackReturn::SUCCESS;
}

CallbackReturn @CLASS@::on_configure(const rclcpp_lifecycle::State &) {
  positions_ = get_node()->get_parameter("position_interfaces").as_string_array();
  velocities_ = get_node()->get_parameter("velocity_interfaces").as_string_array();
  forces_ = get_node()->get_parameter("force_interfaces").as_string_array();
  commands_ = get_node()->get_parameter("command_interfaces").as_string_array();
  commands_positions_ = get_node()->get_parameter("commands_positions").as_bool();
  force_sign_ = get_node()->get_parameter("force_sign").as_double();
  const std::size_t axes = skill_AXES;
  if (positions_.size() != axes || velocities_.size() != axes || forces_.size() != axes || commands_.size() != axes) {
    RCLCPP_ERROR(get_node()->get_logger(), "each list of interfaces needs %d name(s), for @AXIS_NAMES@", skill_AXES);
    return CallbackReturn::ERROR;
  }
  if (force_sign_ != 1.0 && force_sign_ != -1.0) {
    RCLCPP_ERROR(get_node()->get_logger(), "force_sign is 1 (force of the object on the hand) or -1 (of the hand on it)");
    return CallbackReturn::ERROR;
  }
  rearm_ = get_node()->create_service<std_srvs::srv::Trigger>(
    "~/rearm",
    [this](const std::shared_ptr<std_srvs::srv::Trigger::Request>, std::shared_ptr<std_srvs::srv::Trigger::Response> answer) {
      asked_to_rearm_ = true;  // done in update: the state is its own
      answer->success = true;
      answer->message = "asked; the log says whether it runs";
    });
  return CallbackReturn::SUCCESS;
}

InterfaceConfiguration @CLASS@::command_interface_configuration() const {
  return {interface_configuration_type::INDIVIDUAL, commands_};
}

InterfaceConfiguration @CLASS@::state_interface_configuration() const {
  std::vector<std::string> all = positions_;
  all.insert(all.end(), velocities_.begin(), velocities_.end());
  all.insert(all.end(), forces_.begin(), forces_.end());
  return {interface_configuration_type::INDIVIDUAL, all};
}

CallbackReturn @CLASS@::on_activate(const rclcpp_lifecycle::State &) {
  const unsigned int rate = get_update_rate();
  if (rate != 0 && std::abs(1.0 / rate - skill_DT) > 1e-6) {
    RCLCPP_ERROR(get_node()->get_logger(), "made for @RATE@ Hz, updated at %u Hz: set update_rate, or export with --dt", rate);
    return CallbackReturn::ERROR;
  }
  skill_init(&state_);
  asked_to_rearm_ = false;
  told_ = 0;
  return CallbackReturn::SUCCESS;
}

CallbackReturn @CLASS@::on_deactivate(const rclcpp_lifecycle::State &) {
  if (!commands_positions_) {
    const double rest[skill_AXES] = {};
    (void)command(rest);
  }
  return CallbackReturn::SUCCESS;
}

double @CLASS@::read(std::size_t which) const {
  return state_interfaces_[which].get_optional<double>().value_or(std::numeric_limits<double>::quiet_NaN());
}

bool @CLASS@::command(const double * values) {
  bool all = true;
  for (std::size_t i = 0; i < skill_AXES; ++i) all = command_interfaces_[i].set_value(values[i]) && all;
  return all;
}

return_type @CLASS@::update(const rclcpp::Time & time, const rclcpp::Duration &) {
  skill_obs seen;
  skill_cmd does;
  seen.time = time.seconds();
  seen.force_time = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t i = 0; i < skill_AXES; ++i) {
    seen.position[i] = read(i);
    seen.velocity[i] = read(skill_AXES + i);
    seen.sensor_force[i] = force_sign_ * read(2 * skill_AXES + i);
  }
  skill_step(&state_, &seen, &does);
  if (asked_to_rearm_.exchange(false)) {
    const int refused = skill_rearm(&state_);
    RCLCPP_INFO(get_node()->get_logger(), "re-armed: %s", refused ? skill_reason_text(refused) : "runs");
  }
  if (does.reason != told_) {
    told_ = does.reason;
    if (told_) RCLCPP_WARN(get_node()->get_logger(), "%s: %s (%g)", does.mode == 2 ? "HOLD" : "COMPLY", skill_reason_text(told_), does.reason_value);
    else RCLCPP_INFO(get_node()->get_logger(), "runs");
  }
  return command(commands_positions_ ? does.position : does.velocity) ? return_type::OK : return_type::ERROR;
}

}  // namespace @PACKAGE@

PLUGINLIB_EXPORT_CLASS(@PACKAGE@::@CLASS@, controller_interface::ControllerInterface)
"""

CMAKE = """\
# made by comanip; do not edit: export again
cmake_minimum_required(VERSION 3.16)
project(@PACKAGE@ C CXX)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_EXTENSIONS OFF) # extensions would let a compiler contract a multiplication and an addition into one
set(CMAKE_CXX_STANDARD 17)

find_package(ament_cmake REQUIRED)
find_package(controller_interface REQUIRED)
find_package(pluginlib REQUIRED)
find_package(rclcpp REQUIRED)
find_package(rclcpp_lifecycle REQUIRED)
find_package(std_srvs REQUIRED)

add_library(@PACKAGE@ SHARED src/@PACKAGE@.cpp src/skill.c)
target_include_directories(@PACKAGE@ PUBLIC include src)
target_compile_options(@PACKAGE@ PRIVATE -Wall -Wextra)
ament_target_dependencies(@PACKAGE@ controller_interface pluginlib rclcpp rclcpp_lifecycle std_srvs)
pluginlib_export_plugin_description_file(controller_interface @PACKAGE@.xml)

install(TARGETS @PACKAGE@ LIBRARY DESTINATION lib)
install(DIRECTORY include/ DESTINATION include)
install(DIRECTORY config launch DESTINATION share/@PACKAGE@)
ament_package()
"""

PACKAGE = """\
<?xml version="1.0"?>
<!-- made by comanip; do not edit: export again -->
<package format="3">
  <name>@PACKAGE@</name>
  <version>1.0.0</version>
  <description>A skill learned by demonstration (@ROLE@, axes @AXIS_NAMES@), as a controller of ros2_control</description>
  <maintainer email="nobody@example.org">you</maintainer>
  <license>the skill's owner's</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <depend>controller_interface</depend>
  <depend>pluginlib</depend>
  <depend>rclcpp</depend>
  <depend>rclcpp_lifecycle</depend>
  <depend>std_srvs</depend>
  <exec_depend>controller_manager</exec_depend>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""

PLUGIN = """\
<!-- made by comanip; do not edit: export again -->
<library path="@PACKAGE@">
  <class name="@PACKAGE@/@CLASS@" type="@PACKAGE@::@CLASS@" base_class_type="controller_interface::ControllerInterface">
    <description>Carries an object together with a person (@ROLE@), velocity of the hand from force, within a safety envelope.</description>
  </class>
</library>
"""

CONFIG = """\
# made by comanip; names of YOUR robot's interfaces go here, one an axis, in the order @AXIS_NAMES@
controller_manager:
  ros__parameters:
    update_rate: @RATE@  # [Hz] the skill was exported for this

@PACKAGE@:
  ros__parameters:
    type: @PACKAGE@/@CLASS@
    position_interfaces: @POSITIONS@  # [m] hand, in the frame of the lessons
    velocity_interfaces: @VELOCITIES@  # [m/s]
    force_interfaces: @FORCES@  # [N] raw, weight included, along the same axes: a sensor that turns with the hand must be rotated first
    force_sign: 1.0  # 1: what the object does to the hand; -1: what the hand does to the object
    command_interfaces: @COMMANDS@
    commands_positions: false  # true: the interfaces take positions [m]
"""

LAUNCH = '''\
"""made by comanip: spawns the controller, inactive, beside a controller manager that runs."""

from launch import LaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    parameters = PathJoinSubstitution([FindPackageShare("@PACKAGE@"), "config", "@PACKAGE@.yaml"])
    arguments = ["@PACKAGE@", "--inactive", "--param-file", parameters]
    return LaunchDescription([Node(package="controller_manager", executable="spawner", arguments=arguments)])
'''

README = """\
# @PACKAGE@

<!-- made by comanip; do not edit: export again -->
A skill that was learned by demonstration (@ROLE@, axes @AXIS_NAMES@) as a controller of ros2_control, Jazzy or later: force of the
wrist in, velocity of the hand out, every @DT@ s, within a safety envelope. `src/skill.c` is the whole of it, `src/skill.h` says units,
limits and reasons.

**Nobody has tried this on an arm, and it was compiled against stubs of the interfaces that it uses, never against ROS.** Not a
certified safety function.

1. Put the names of your robot's interfaces into `config/@PACKAGE@.yaml`: hand position and velocity, and force, along the axes
   @AXIS_NAMES@ of the lessons; set `update_rate` of the controller manager to @RATE@.
2. `colcon build --packages-select @PACKAGE@`, source it, `ros2 launch @PACKAGE@ @PACKAGE@.launch.py`: the controller is inactive.
3. Hold the object at rest, both of you; `ros2 control switch_controllers --activate @PACKAGE@`. The first 0.25 s weigh it.
4. At HOLD the hand brakes and stays stiff, and the log says why. When the cause is gone:
   `ros2 service call /@PACKAGE@/rearm std_srvs/srv/Trigger`.

The same file tests itself: `cc -std=c99 -O2 -DCOMANIP_SELF_TEST src/skill.c -lm && ./a.out`.
"""

FILES = {
    "CMakeLists.txt": CMAKE,
    "package.xml": PACKAGE,
    "@PACKAGE@.xml": PLUGIN,
    "README.md": README,
    "config/@PACKAGE@.yaml": CONFIG,
    "launch/@PACKAGE@.launch.py": LAUNCH,
    "include/@PACKAGE@/@PACKAGE@.hpp": HPP,
    "src/@PACKAGE@.cpp": CPP,
}
