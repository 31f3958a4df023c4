//! What changes the whole process: signal handlers, SCHED_DEADLINE, locked memory.

mod deadline;
mod deadline_on_few_cores;
mod memory_and_latency;
mod signals;
