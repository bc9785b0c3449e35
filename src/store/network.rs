//! Whether other machines may be at work in a folder, of which no lock tells for certain.

use std::fs::File;

use crate::store::kernel;

/// File systems that several machines share, or that are made by programs that may do so, by the numbers of Linux.
const NETWORK: [(u32, &str); 21] = [
    (0x6969, "NFS"),
    (0x517B, "SMB"),
    (0xFF53_4D42, "CIFS"),
    (0xFE53_4D42, "SMB"),
    (0x6573_5546, "FUSE"),
    (0x0BD0_0BD0, "Lustre"),
    (0x4750_4653, "GPFS"),
    (0x1983_0326, "BeeGFS"),
    (0x00C3_6400, "Ceph"),
    (0x0102_1997, "9p"),
    (0x5346_414F, "AFS"),
    (0x6B41_4653, "AFS"),
    (0x0116_1970, "GFS2"),
    (0x7461_636F, "OCFS2"),
    (0x7375_7245, "Coda"),
    (0x2003_0528, "OrangeFS"),
    (0xAAD7_AAEA, "PanFS"),
    (0x0131_11A8, "IBRIX"),
    (0x786F_4256, "VirtualBox's folders"),
    (0xBACB_ACBC, "VMware's folders"),
    (0x7C7C_6673, "Parallels' folders"),
];

/// The name of the network file system on which a file lies; none for a local one, and where the system does not tell.
pub(super) fn kind(file: &File) -> Option<&'static str> {
    #[cfg(test)]
    if let Some(kind) = fake::get() {
        return Some(kind);
    }
    named(kernel::file_system(file)?)
}

fn named(number: u32) -> Option<&'static str> {
    NETWORK.iter().find(|(known, _)| *known == number).map(|(_, name)| *name)
}

/// A network file system, for the calling test.
#[cfg(test)]
pub(super) mod fake {
    use std::cell::Cell;

    thread_local!(static KIND: Cell<Option<&'static str>> = const { Cell::new(None) });

    pub fn set(kind: Option<&'static str>) {
        KIND.set(kind);
    }

    pub fn get() -> Option<&'static str> {
        KIND.get()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Local file systems (ext4, tmpfs, XFS, Btrfs, ZFS, overlay) are none of them, and no number stands twice.
    #[test]
    fn local_file_systems_are_no_network() {
        for local in [0xEF53, 0x0102_1994, 0x5846_5342, 0x9123_683E, 0x2FC1_2FC1, 0x794C_7630] {
            assert_eq!(named(local), None);
        }
        assert_eq!(named(0x6969), Some("NFS"));
        let numbers: std::collections::BTreeSet<u32> = NETWORK.iter().map(|(number, _)| *number).collect();
        assert_eq!(numbers.len(), NETWORK.len());
    }
}
