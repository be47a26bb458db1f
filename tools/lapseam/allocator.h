#pragma once

namespace lapseam::tool {

/// What the process's allocator keeps for later; first thing in main(). The library leaves that to programs.
void set_up_allocator();

}  // namespace lapseam::tool
