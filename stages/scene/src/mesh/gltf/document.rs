//! What a glTF document says, as far as triangles need it.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// A list has at most so many entries: `{}` takes three bytes of a file and a hundred of memory.
const MOST_ENTRIES: usize = 1 << 17;

#[derive(Deserialize)]
pub struct Document<'a> {
    #[serde(default)]
    pub scene: Index,
    #[serde(default)]
    pub scenes: List<Scene>,
    #[serde(default)]
    pub nodes: List<Node>,
    #[serde(default)]
    pub meshes: List<Mesh>,
    #[serde(default)]
    pub accessors: List<Accessor>,
    #[serde(default, rename = "bufferViews")]
    pub views: List<View>,
    #[serde(default, borrow)]
    pub buffers: List<Buffer<'a>>,
}

#[derive(Deserialize)]
pub struct Scene {
    #[serde(default)]
    pub nodes: List<Index>,
}

#[derive(Deserialize)]
pub struct Node {
    pub mesh: Option<Index>,
    #[serde(default)]
    pub children: List<Index>,
    // Few nodes have them: they are kept elsewhere.
    pub matrix: Option<Box<[f64; 16]>>,
    pub translation: Option<Box<[f64; 3]>>,
    pub rotation: Option<Box<[f64; 4]>>,
    pub scale: Option<Box<[f64; 3]>>,
    #[serde(default)]
    pub extensions: NodeExtensions,
}

#[derive(Default, Deserialize)]
pub struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<IgnoredAny>,
}

#[derive(Deserialize)]
pub struct Mesh {
    #[serde(default)]
    pub primitives: List<Primitive>,
}

#[derive(Deserialize)]
pub struct Primitive {
    pub attributes: Attributes,
    pub indices: Option<Index>,
    pub mode: Option<Index>,
    #[serde(default)]
    pub extensions: PrimitiveExtensions,
}

#[derive(Deserialize)]
pub struct Attributes {
    #[serde(rename = "POSITION")]
    pub position: Option<Index>,
}

#[derive(Default, Deserialize)]
pub struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub draco: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Accessor {
    pub buffer_view: Option<Index>,
    #[serde(default)]
    pub byte_offset: Whole,
    pub component_type: Whole,
    pub count: Whole,
    #[serde(rename = "type")]
    pub kind: Kind,
    #[serde(default)]
    pub normalized: bool,
    pub sparse: Option<Box<Sparse>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub enum Kind {
    #[serde(rename = "SCALAR")]
    Scalar,
    #[serde(rename = "VEC3")]
    Vec3,
    #[serde(other)]
    Other,
}

/// The elements of an accessor that differ from its buffer's.
#[derive(Deserialize)]
pub struct Sparse {
    pub count: Whole,
    pub indices: SparseIndices,
    pub values: SparseValues,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct SparseIndices {
    pub buffer_view: Index,
    #[serde(default)]
    pub byte_offset: Whole,
    pub component_type: Whole,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct SparseValues {
    pub buffer_view: Index,
    #[serde(default)]
    pub byte_offset: Whole,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct View {
    pub buffer: Index,
    #[serde(default)]
    pub byte_offset: Whole,
    pub byte_length: Whole,
    pub byte_stride: Option<Whole>,
    #[serde(default)]
    pub extensions: ViewExtensions,
}

#[derive(Default, Deserialize)]
pub struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub meshopt: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Buffer<'a> {
    pub byte_length: Option<Whole>,
    #[serde(borrow)]
    pub uri: Option<Text<'a>>,
}

/// A text of the file, without a copy where it needs none. (`Option<Cow<str>>` is always copied.)
#[derive(Deserialize)]
#[serde(transparent)]
pub struct Text<'a>(#[serde(borrow)] pub Cow<'a, str>);

/// A whole number from 0 on; `4.0` is one, too.
#[derive(Clone, Copy, Default)]
pub struct Whole(pub u64);

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Read;
        impl Visitor<'_> for Read {
            type Value = Whole;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a whole number >= 0")
            }
            fn visit_u64<E: Error>(self, x: u64) -> Result<Whole, E> {
                Ok(Whole(x))
            }
            fn visit_f64<E: Error>(self, x: f64) -> Result<Whole, E> {
                let whole = x as u64;
                // What a cast would change is none.
                if x < 9e15 && whole as f64 == x {
                    Ok(Whole(whole))
                } else {
                    Err(E::custom(format!("{x} is no whole number >= 0")))
                }
            }
        }
        deserializer.deserialize_u64(Read)
    }
}

/// The place of something in its list.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Index(pub u32);

impl Index {
    pub fn place(self) -> usize {
        self.0 as usize
    }
}

impl<'de> Deserialize<'de> for Index {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let Whole(i) = Whole::deserialize(deserializer)?;
        u32::try_from(i)
            .map(Index)
            .map_err(|_| D::Error::custom(format!("{i} is no place in a list: it must be below 2^32")))
    }
}

/// A list that is read up to [`MOST_ENTRIES`].
pub struct List<T>(pub Vec<T>);

impl<T> Default for List<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for List<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Read<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Read<T> {
            type Value = Vec<T>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a list")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Vec<T>, A::Error> {
                let mut list = Vec::new();
                while let Some(entry) = entries.next_element()? {
                    if list.len() == MOST_ENTRIES {
                        let rule =
                            format!("a list of more than {MOST_ENTRIES} entries; join its parts before the export");
                        return Err(A::Error::custom(rule));
                    }
                    list.push(entry);
                }
                Ok(list)
            }
        }
        deserializer.deserialize_seq(Read(PhantomData)).map(List)
    }
}
