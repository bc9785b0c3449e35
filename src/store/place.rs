//! Where in the packs the newest frame of a digest is.

use std::cmp::Ordering;

use crate::digest::Digest;
use crate::store::frame::HEADER;

/// What a digest names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub(super) enum Named {
    /// The record of the instance with this key.
    Record = 0,
    /// The blob with this digest.
    Blob = 1,
    /// The latest record that was made under this label (pipeline, stage and point of its axes).
    Label = 2,
    /// The latest record of this work, done for longer or shorter: with this state key.
    Work = 3,
    /// The latest record of this kind of stage.
    Kind = 4,
}

impl Named {
    pub const ALL: [Self; 5] = [Self::Record, Self::Blob, Self::Label, Self::Work, Self::Kind];
}

/// Where a digest's newest frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Id of the pack in this process ([`State`](super::state::State)); [`Place::FORGOTTEN`] where the newest frame says that
    /// older ones do not hold, [`Place::RELEASED`] where it says that they were given back, [`Place::UNKNOWN`] where only its
    /// use is known.
    pub pack: u32,
    /// Of the frame's header. No pack has as many bytes as 32 bits count.
    pub offset: u32,
    /// Of the payload.
    pub length: u32,
    /// Unix time, s, when a record was last used or published.
    pub used: u32,
    pub stamp: u64,
}

impl Place {
    pub const FORGOTTEN: u32 = u32::MAX;
    pub const RELEASED: u32 = u32::MAX - 1;
    pub const UNKNOWN: u32 = u32::MAX - 2;

    /// Of what was used at a time, wherever it is.
    pub fn unknown(used: u32) -> Self {
        Self { pack: Self::UNKNOWN, offset: 0, length: 0, used, stamp: 0 }
    }

    pub fn is_here(&self) -> bool {
        self.pack < Self::UNKNOWN
    }

    pub fn is_released(&self) -> bool {
        self.pack == Self::RELEASED
    }

    pub fn is_known(&self) -> bool {
        self.pack != Self::UNKNOWN
    }

    /// Whether both are one and the same frame.
    pub fn is(&self, other: &Self) -> bool {
        (self.pack, self.offset, self.stamp) == (other.pack, other.offset, other.stamp)
    }

    /// The one with the higher stamp holds, the later one of equals; used it was when either was.
    #[must_use]
    pub fn or_newer(self, new: Self) -> Self {
        let holds = if self.stamp <= new.stamp { new } else { self };
        Self { used: self.used.max(new.used), ..holds }
    }
}

/// Unix time as it is kept: until 2106.
pub(super) fn seconds(time_s: u64) -> u32 {
    u32::try_from(time_s).unwrap_or(u32::MAX)
}

/// A digest with what it names and where that is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub digest: Digest,
    pub named: Named,
    pub place: Place,
}

impl Entry {
    /// The order in which entries are sorted.
    pub fn order(&self, other: &Self) -> Ordering {
        self.digest.cmp(&other.digest).then(self.named.cmp(&other.named))
    }

    /// Bytes of its pack that it holds: those of a record or blob.
    pub fn room(&self) -> i64 {
        let holds = matches!(self.named, Named::Record | Named::Blob) && self.place.is_here();
        if holds { HEADER as i64 + i64::from(self.place.length) } else { 0 }
    }
}
