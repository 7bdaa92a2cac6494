//! Tasks: what the robot is asked to do and what it is paid for.
