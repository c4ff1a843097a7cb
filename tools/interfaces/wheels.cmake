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
