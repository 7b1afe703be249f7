# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Makes a build against ROS 2 from Python wheels work: cmake -DCMAKE_PROJECT_INCLUDE=<this file>.
# A build in an ordinary ROS 2 installation does not need it.

# The wheels lie in a Python environment (the .venv, or pip's isolated build environment):
# look for ROS packages there.
if(NOT DEFINED Python3_EXECUTABLE)
  find_package(Python3 REQUIRED COMPONENTS Interpreter)
endif()
execute_process(
  COMMAND "${Python3_EXECUTABLE}" -c
    "import ament_package, pathlib; print(pathlib.Path(ament_package.__file__).parents[4])"
  OUTPUT_VARIABLE ros_wheels_prefix
  OUTPUT_STRIP_TRAILING_WHITESPACE
  COMMAND_ERROR_IS_FATAL ANY)
list(PREPEND CMAKE_PREFIX_PATH "${ros_wheels_prefix}")
if(NOT DEFINED ENV{AMENT_PREFIX_PATH})
  set(ENV{AMENT_PREFIX_PATH} "${ros_wheels_prefix}")
endif()

# The wheels' CMake exports name include directories of the machine that built them, and
# CMake refuses to generate with a directory that does not exist. Drop those: after the
# project has been read, before CMake generates.
function(ros_wheels_drop_missing_include_directories)
  get_directory_property(targets IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories "${target}" INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT directories)
      continue()
    endif()
    set(existing)
    foreach(directory IN LISTS directories)
      if(directory MATCHES "^\\$<" OR EXISTS "${directory}")
        list(APPEND existing "${directory}")
      endif()
    endforeach()
    set_target_properties("${target}" PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${existing}")
  endforeach()
endfunction()
cmake_language(DEFER CALL ros_wheels_drop_missing_include_directories)
