# Source this in bash: every executable of semantic_slam on PATH, its Python packages importable.
#     source env.sh
# Works in a checkout set up by `make setup`, and on a machine with ROS 2 after `colcon build --base-paths . msg_defs`.

_semantic_slam_root="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
_semantic_slam_options="$-"
set +eu # the generated setup files read unset variables

if [ -x "$_semantic_slam_root/.venv/bin/colcon" ]; then
  # ROS comes as wheels: the virtual environment is the ament and CMake prefix.
  source "$_semantic_slam_root/.venv/bin/activate"
  export AMENT_PREFIX_PATH="$VIRTUAL_ENV" CMAKE_PREFIX_PATH="$VIRTUAL_ENV"
  # What the wheels' start-up hook would set by starting every Python a second time.
  export LD_LIBRARY_PATH="$VIRTUAL_ENV/lib$(printf ':%s' "$VIRTUAL_ENV"/lib/python3.*/site-packages/ros_*.libs)"
  export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
elif [ -z "${AMENT_PREFIX_PATH:-}" ] && [ -f /opt/ros/jazzy/setup.bash ]; then
  source /opt/ros/jazzy/setup.bash
fi

if [ -f "$_semantic_slam_root/install/local_setup.bash" ]; then
  source "$_semantic_slam_root/install/local_setup.bash"
  export PATH="$_semantic_slam_root/install/semantic_slam/lib/semantic_slam:$PATH"
elif [ -z "${SEMANTIC_SLAM_BUILDING:-}" ]; then
  echo "env.sh: nothing is built yet; run 'make setup' first" >&2
fi

case "$_semantic_slam_options" in *e*) set -e ;; esac
case "$_semantic_slam_options" in *u*) set -u ;; esac
unset _semantic_slam_root _semantic_slam_options
