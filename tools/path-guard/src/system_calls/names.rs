//! The names of system calls.

/// Names each of these by its number.
macro_rules! names {
    ($($constant:ident $name:literal,)*) => {
        /// The name of a system call; empty if it is not one of the common ones.
        pub(super) fn name(number: i64) -> &'static str {
            match number {
                $(libc::$constant => $name,)*
                _ => "",
            }
        }
    };
}

names! {
    SYS_accept4 "accept4", SYS_access "access", SYS_brk "brk", SYS_clock_nanosleep "clock_nanosleep", SYS_clone "clone", SYS_clone3 "clone3",
    SYS_close "close", SYS_connect "connect", SYS_dup "dup", SYS_epoll_create1 "epoll_create1", SYS_epoll_ctl "epoll_ctl",
    SYS_epoll_pwait "epoll_pwait", SYS_epoll_wait "epoll_wait", SYS_eventfd2 "eventfd2", SYS_execve "execve", SYS_exit "exit",
    SYS_exit_group "exit_group", SYS_fcntl "fcntl", SYS_fdatasync "fdatasync", SYS_fork "fork", SYS_fstat "fstat", SYS_fsync "fsync",
    SYS_ftruncate "ftruncate", SYS_futex "futex", SYS_getcwd "getcwd", SYS_getdents64 "getdents64", SYS_getpid "getpid", SYS_getppid "getppid",
    SYS_getrandom "getrandom", SYS_getrusage "getrusage", SYS_gettid "gettid", SYS_ioctl "ioctl", SYS_kill "kill", SYS_lseek "lseek",
    SYS_madvise "madvise", SYS_mlock "mlock", SYS_membarrier "membarrier",
    SYS_mmap "mmap", SYS_mprotect "mprotect", SYS_mremap "mremap", SYS_munlock "munlock",
    SYS_munmap "munmap", SYS_nanosleep "nanosleep", SYS_newfstatat "newfstatat", SYS_open "open", SYS_openat "openat", SYS_pipe2 "pipe2",
    SYS_poll "poll", SYS_ppoll "ppoll", SYS_prctl "prctl", SYS_pread64 "pread64", SYS_pwrite64 "pwrite64", SYS_read "read",
    SYS_readlink "readlink", SYS_readv "readv", SYS_recvfrom "recvfrom", SYS_recvmsg "recvmsg", SYS_rt_sigaction "rt_sigaction",
    SYS_rt_sigprocmask "rt_sigprocmask", SYS_rt_sigreturn "rt_sigreturn", SYS_sched_getaffinity "sched_getaffinity",
    SYS_sched_getparam "sched_getparam", SYS_sched_getscheduler "sched_getscheduler", SYS_sched_setaffinity "sched_setaffinity",
    SYS_sched_setscheduler "sched_setscheduler", SYS_sched_yield "sched_yield", SYS_select "select", SYS_sendmsg "sendmsg",
    SYS_sendto "sendto", SYS_sigaltstack "sigaltstack", SYS_socket "socket", SYS_socketpair "socketpair", SYS_stat "stat", SYS_statx "statx",
    SYS_tgkill "tgkill", SYS_timer_settime "timer_settime", SYS_timerfd_create "timerfd_create", SYS_timerfd_settime "timerfd_settime", SYS_unlink "unlink", SYS_vfork "vfork",
    SYS_wait4 "wait4", SYS_write "write", SYS_writev "writev",
}
