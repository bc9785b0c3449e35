//! How much memory there is for a run, by what the system says: the machine, its control groups, the limits of the process.

use std::fs;
use std::path::{Path, PathBuf};

/// What sets a budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// `--memory`.
    Asked,
    /// What the machine has free.
    Machine,
    /// A control group: that of a container, a batch job or a service.
    Group,
    /// Address space (`ulimit -v`).
    AddressSpace,
    /// Data (`ulimit -d`).
    Data,
}

impl Limit {
    /// Ends the sentence "there are N GB ..".
    pub fn text(self) -> &'static str {
        match self {
            Self::Asked => "by --memory",
            Self::Machine => "free on this machine",
            Self::Group => "left in the control group of this process (container or batch job)",
            Self::AddressSpace => "left of the address space that this process may have (ulimit -v)",
            Self::Data => "left of the data that this process may have (ulimit -d)",
        }
    }
}

/// What a run may take beside what the program has already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    pub bytes: u64,
    pub by: Limit,
}

/// Address space of a thread's stack.
const STACK: u64 = 2 << 20;
/// Address space that glibc sets apart for small pieces of each thread, as long as there is some.
const ARENA: u64 = 64 << 20;

impl Budget {
    /// The least of what the system tells of, for a run on `threads` threads; `asked` instead, where it is given. `None` where it tells nothing
    /// (other systems than Linux): then nothing is refused, and all instances run side by side.
    pub fn of(asked: Option<u64>, threads: usize) -> Option<Self> {
        match asked {
            Some(bytes) => Some(Self { bytes, by: Limit::Asked }),
            None => Self::read(Path::new("/"), threads),
        }
    }

    /// From the files of a system whose root is `root`.
    fn read(root: &Path, threads: usize) -> Option<Self> {
        let text = |path: &str| fs::read_to_string(root.join(path)).unwrap_or_default();
        let (status, limits) = (text("proc/self/status"), text("proc/self/limits"));
        // The stacks of the pool and of as many instances.
        let stacks = 2 * threads as u64 * STACK;
        let of_process = |limit: &str, used: &str| {
            let limit = soft_limit(&limits, limit)?;
            Some(limit.saturating_sub(kilobytes(&status, used).unwrap_or(0)).saturating_sub(stacks))
        };
        // No more than a quarter goes into arenas: where addresses are scarce there is one for all.
        let addresses = of_process("Max address space", "VmSize:").map(|b| b - (b / 4).min(threads as u64 * ARENA));
        let found = [
            (kilobytes(&text("proc/meminfo"), "MemAvailable:"), Limit::Machine),
            (group(root, &text("proc/self/cgroup")), Limit::Group),
            (addresses, Limit::AddressSpace),
            (of_process("Max data size", "VmData:"), Limit::Data),
        ];
        let known = found.into_iter().filter_map(|(bytes, by)| Some(Self { bytes: bytes?, by }));
        known.min_by_key(|budget| budget.bytes)
    }
}

/// The name of the processor, where the system says it.
pub fn processor() -> Option<String> {
    let text = fs::read_to_string("/proc/cpuinfo").ok()?;
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'))?.1.trim();
    Some(name.to_owned())
}

/// `NAME   123 kB` in bytes.
fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// `Max address space   SOFT   HARD   bytes`; `None` where it is unlimited.
fn soft_limit(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.split_whitespace().next()?.parse().ok()
}

/// What is left in the control groups of this process, the tightest of them and those above; pages of files that can be given back count as free.
fn group(root: &Path, groups: &str) -> Option<u64> {
    let left = |folder: &Path, [limit, used]: [&str; 2], reclaimable: &str| -> Option<u64> {
        let number = |name: &str| fs::read_to_string(folder.join(name)).ok()?.trim().parse::<u64>().ok();
        let (limit, used) = (number(limit)?, number(used)?);
        let stat = fs::read_to_string(folder.join("memory.stat")).unwrap_or_default();
        let files = stat.lines().find_map(|line| line.strip_prefix(reclaimable)?.trim().parse::<u64>().ok());
        Some(limit.saturating_sub(used.saturating_sub(files.unwrap_or(0))))
    };
    let mut least = None;
    for line in groups.lines() {
        // `0::/path` is version 2, `4:memory:/path` version 1.
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (parts.next(), parts.next()) else { continue };
        let (mount, names, reclaimable) = match controllers {
            "" => ("sys/fs/cgroup", ["memory.max", "memory.current"], "inactive_file "),
            c if c.split(',').any(|c| c == "memory") => {
                ("sys/fs/cgroup/memory", ["memory.limit_in_bytes", "memory.usage_in_bytes"], "total_inactive_file ")
            }
            _ => continue,
        };
        let mount = root.join(mount);
        let own: PathBuf = mount.join(path.trim_start_matches('/'));
        // Within a container the path is that of the host: only the mount itself is there, and is the group.
        for folder in own.ancestors().take_while(|folder| folder.starts_with(&mount)) {
            least = least.into_iter().chain(left(folder, names, reclaimable)).min();
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;

    const GB: u64 = 1 << 30;

    /// A system in a folder: what its files say.
    fn system(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        root
    }

    fn limits(address_space: &str, data: &str) -> String {
        format!(
            "Limit                     Soft Limit           Hard Limit           Units     \n\
             Max data size             {data}            unlimited            bytes     \n\
             Max address space         {address_space}            unlimited            bytes     \n"
        )
    }

    const MEMINFO: (&str, &str) = ("proc/meminfo", "MemTotal:  16777216 kB\nMemAvailable:    8388608 kB\n");
    const STATUS: (&str, &str) = ("proc/self/status", "VmSize:\t  102400 kB\nVmData:\t   51200 kB\n");

    /// The tightest limit counts, whichever it is, less what is in use.
    #[test]
    fn the_tightest_limit_counts() {
        let none = limits("unlimited", "unlimited");
        let read = |files: &[(&str, &str)], threads| Budget::read(system(files).path(), threads);
        assert_eq!(read(&[], 4), None);
        let machine = [MEMINFO, STATUS, ("proc/self/limits", &none)];
        assert_eq!(read(&machine, 4), Some(Budget { bytes: 8 * GB, by: Limit::Machine }));
        // 1 GiB of addresses less 100 MiB in use and 4 stacks of 2 MiB; then less 128 MiB for two arenas.
        let tight = limits("1073741824", "unlimited");
        let found = read(&[MEMINFO, STATUS, ("proc/self/limits", &tight)], 2);
        assert_eq!(found, Some(Budget { bytes: (1024 - 100 - 8 - 128) << 20, by: Limit::AddressSpace }));
        let tight = limits("unlimited", "104857600");
        let found = read(&[MEMINFO, STATUS, ("proc/self/limits", &tight)], 1);
        assert_eq!(found, Some(Budget { bytes: (100 - 50 - 4) << 20, by: Limit::Data }));
        assert_eq!(Budget::of(Some(5), 1), Some(Budget { bytes: 5, by: Limit::Asked }));
    }

    /// Control groups of both versions, the tighter one above included; file pages that can be given back are free.
    #[test]
    fn control_groups_are_read() {
        let v2 = [
            MEMINFO,
            ("proc/self/cgroup", "0::/jobs/one\n"),
            ("sys/fs/cgroup/jobs/one/memory.max", "max\n"),
            ("sys/fs/cgroup/jobs/one/memory.current", "1073741824\n"),
            ("sys/fs/cgroup/jobs/memory.max", "4294967296\n"),
            ("sys/fs/cgroup/jobs/memory.current", "2147483648\n"),
            ("sys/fs/cgroup/jobs/memory.stat", "anon 1\ninactive_file 1073741824\n"),
        ];
        assert_eq!(Budget::read(system(&v2).path(), 1), Some(Budget { bytes: 3 * GB, by: Limit::Group }));
        // In a container: the path is the host's.
        let v1 = [
            MEMINFO,
            ("proc/self/cgroup", "8:pids:/x\n4:cpu,memory:/docker/abc\n"),
            ("sys/fs/cgroup/memory/memory.limit_in_bytes", "2147483648\n"),
            ("sys/fs/cgroup/memory/memory.usage_in_bytes", "1073741824\n"),
        ];
        assert_eq!(Budget::read(system(&v1).path(), 1), Some(Budget { bytes: GB, by: Limit::Group }));
        // A group over its limit leaves nothing, and not the largest number.
        let over = [
            ("proc/self/cgroup", "0::/\n"),
            ("sys/fs/cgroup/memory.max", "5\n"),
            ("sys/fs/cgroup/memory.current", "9"),
        ];
        assert_eq!(Budget::read(system(&over).path(), 1), Some(Budget { bytes: 0, by: Limit::Group }));
    }
}
