# Included by each project that is built against the ROS wheels. Their exported targets name the headers of Python and
# numpy in the image in which the wheels were made, and cmake refuses a folder that does not exist. Both folders are
# found again by the generators themselves.
function(forget_the_image_of_the_wheels)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(folders)
      list(FILTER folders EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${folders}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL forget_the_image_of_the_wheels)

# The generated C++ files of a library are compiled as one, because nearly all of the time goes into the headers that each of
# them includes. The C files of a library define names twice, and those of introspection_cpp specialise templates after their use.
function(compile_each_library_as_one_file)
  foreach(kind c cpp fastrtps_c fastrtps_cpp)
    if(TARGET ${PROJECT_NAME}__rosidl_typesupport_${kind})
      set_target_properties(${PROJECT_NAME}__rosidl_typesupport_${kind} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL compile_each_library_as_one_file)
