//! The control groups of a process, from `/proc/self/cgroup`, and where their files are, from
//! `/proc/self/mounts`.

/// The path of the version 1 group with the controller `controller`.
///
/// ```
/// use luna_machine::facts::control_group::group_one;
///
/// assert_eq!(group_one("3:cpu,cpuacct:/user.slice\n0::/\n", "cpu"), Some("/user.slice"));
/// ```
pub fn group_one<'a>(groups: &'a str, controller: &str) -> Option<&'a str> {
    groups.lines().find_map(|line| {
        let (_, rest) = line.split_once(':')?;
        let (controllers, path) = rest.split_once(':')?;
        controllers
            .split(',')
            .any(|one| one == controller)
            .then_some(path)
    })
}

/// The path of the version 2 group.
///
/// ```
/// assert_eq!(luna_machine::facts::control_group::group_two("0::/user.slice\n"), Some("/user.slice"));
/// ```
pub fn group_two(groups: &str) -> Option<&str> {
    groups.lines().find_map(|line| line.strip_prefix("0::"))
}

/// Where the version 1 hierarchy of a controller is mounted.
///
/// ```
/// use luna_machine::facts::control_group::mount_of_one;
///
/// let mounts = "cgroup /sys/fs/cgroup/cpu cgroup rw,nosuid,cpu 0 0\n";
/// assert_eq!(mount_of_one(mounts, "cpu"), Some("/sys/fs/cgroup/cpu"));
/// ```
pub fn mount_of_one<'a>(mounts: &'a str, controller: &str) -> Option<&'a str> {
    mount(mounts, |kind, options| {
        kind == "cgroup" && options.split(',').any(|option| option == controller)
    })
}

/// Where the version 2 hierarchy is mounted.
///
/// ```
/// use luna_machine::facts::control_group::mount_of_two;
///
/// assert_eq!(mount_of_two("cgroup2 /sys/fs/cgroup cgroup2 rw 0 0\n"), Some("/sys/fs/cgroup"));
/// ```
pub fn mount_of_two(mounts: &str) -> Option<&str> {
    mount(mounts, |kind, _| kind == "cgroup2")
}

/// A file of a group, below where its hierarchy is mounted.
///
/// ```
/// use luna_machine::facts::control_group::file;
///
/// assert_eq!(file("/sys/fs/cgroup", "/", "cpu.max"), "/sys/fs/cgroup/cpu.max");
/// assert_eq!(file("/sys/fs/cgroup", "/a", "cpu.max"), "/sys/fs/cgroup/a/cpu.max");
/// ```
pub fn file(mount: &str, group: &str, name: &str) -> String {
    format!("{mount}{}/{name}", group.trim_end_matches('/'))
}

fn mount(mounts: &str, is_it: impl Fn(&str, &str) -> bool) -> Option<&str> {
    mounts.lines().find_map(|line| {
        let mut fields = line.split(' ').skip(1);
        let (directory, kind, options) = (fields.next()?, fields.next()?, fields.next()?);
        is_it(kind, options).then_some(directory)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_of_both_versions() {
        let one = "9:name=systemd:/\n4:memory:/x\n2:cpuacct:/\n1:cpu,cpuacct:/user.slice\n0::/\n";
        assert_eq!(group_one(one, "cpu"), Some("/user.slice"));
        let two = "0::/user.slice/user-1000.slice\n";
        assert_eq!(
            (group_one(two, "cpu"), group_two(two)),
            (None, Some("/user.slice/user-1000.slice"))
        );
        let mounts = "proc /proc proc rw 0 0\ncgroup /sys/fs/cgroup/cpuset cgroup rw,cpuset 0 0\n\
                      cgroup /sys/fs/cgroup/cpu,cpuacct cgroup rw,nosuid,cpu,cpuacct 0 0\n";
        assert_eq!(
            mount_of_one(mounts, "cpu"),
            Some("/sys/fs/cgroup/cpu,cpuacct")
        );
        assert_eq!(
            mount_of_one("cgroup2 /sys/fs/cgroup cgroup2 rw 0 0\n", "cpu"),
            None
        );
        assert_eq!((mount_of_two(mounts), mount_of_two("x\n")), (None, None));
    }
}
