# The ROS wheels' CMake packages name include directories of the machine that built them; CMake stops at those that do
# not exist here. Passed as CMAKE_PROJECT_INCLUDE, this removes them from every imported target once the project has
# been read. On an ordinary ROS installation nothing is missing and nothing changes.
function(remove_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    set(present "")
    foreach(directory IN LISTS directories)
      # Generator expressions are not paths yet.
      if(directory MATCHES "\\$<" OR IS_DIRECTORY "${directory}")
        list(APPEND present "${directory}")
      endif()
    endforeach()
    if(directories AND NOT present STREQUAL directories)
      set_property(TARGET ${target} PROPERTY INTERFACE_INCLUDE_DIRECTORIES "${present}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL remove_missing_include_directories)
