//! Accessors: numbers in a glTF file's buffers.

use glam::{Vec3, Vec4};
use gltf_json::accessor::{Accessor, ComponentType, Type};
use gltf_json::buffer::View;
use gltf_json::root::Index;
use gltf_json::validation::Checked;

use super::{Document, Refusal, find, known};
use crate::scene::validate::VERTICES_MAX;

/// The elements of an accessor, which are known to lie in their buffer.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
}

impl Document {
    /// The bytes of a buffer view.
    pub(super) fn view(&self, index: Index<View>, what: &str) -> Result<&[u8], Refusal> {
        let place = index.value();
        let view = find(
            &self.root.buffer_views,
            place,
            format_args!("{what}: buffer view"),
        )?;
        let buffer = self.buffers.get(view.buffer.value());
        let offset = view.byte_offset.map_or(0, |offset| offset.0);
        let range = usize::try_from(offset)
            .ok()
            .zip(usize::try_from(view.byte_length.0).ok());
        let bytes = buffer
            .zip(range)
            .and_then(|(buffer, (offset, length))| buffer.get(offset..offset.checked_add(length)?));
        bytes.ok_or_else(|| {
            format!(
                "{what}: buffer view {place} has bytes {offset} and {} on, which buffer {} does not have",
                view.byte_length.0,
                view.buffer.value()
            )
        })
    }

    /// All numbers of an accessor of type `wanted`, element by element. Integers are converted to
    /// f32, normalised ones to [0, 1] or [−1, 1].
    pub(super) fn numbers(
        &self,
        index: Index<Accessor>,
        wanted: Type,
        what: &str,
    ) -> Result<Vec<f32>, Refusal> {
        let (accessor, what) = self.accessor(index, wanted, what)?;
        let component = component(accessor, &what)?;
        let (width, count) = (components(wanted), count(accessor, &what)?);
        let mut numbers = vec![0.0; width * count];
        let decode = |bytes: &[u8]| number(bytes, component, accessor.normalized);
        if let Some(elements) = self.elements(accessor, width * size(component), count, &what)? {
            elements.decode(&mut numbers, size(component), decode);
        }
        // Sparse values replace those of the buffer view, or the zeros that stand for a missing
        // one.
        if let Some(sparse) = &accessor.sparse {
            let changed = usize::try_from(sparse.count.0)
                .ok()
                .filter(|changed| *changed <= count);
            let changed = changed.ok_or_else(|| {
                format!(
                    "{what}: {} of its {count} elements are replaced",
                    sparse.count.0
                )
            })?;
            let places = self.sparse_places(sparse, changed, &what)?;
            let values = self.view(sparse.values.buffer_view, &what)?;
            let bytes = width * size(component);
            let values = part(values, sparse.values.byte_offset.0, bytes, bytes, changed);
            let values =
                values.ok_or_else(|| format!("{what}: its replaced values are cut off"))?;
            let mut replaced = vec![0.0; width * changed];
            values.decode(&mut replaced, size(component), decode);
            for (place, value) in places.into_iter().zip(replaced.chunks(width)) {
                let element = numbers.get_mut(place * width..place * width + width);
                let element = element
                    .ok_or_else(|| format!("{what}: element {place} of {count} is replaced"))?;
                element.copy_from_slice(value);
            }
        }
        Ok(numbers)
    }

    /// All colours of an accessor, with an alpha of 1 if they are RGB; clamped to [0, 1] as the
    /// specification demands.
    pub(super) fn colors(&self, index: Index<Accessor>, what: &str) -> Result<Vec<Vec4>, Refusal> {
        let what = format!("{what}, its colours");
        let accessor = self.root.accessors.get(index.value());
        let is_rgb = accessor.is_some_and(|found| found.type_ == Checked::Valid(Type::Vec3));
        if let Some(accessor) = accessor
            && component(accessor, &what)? != ComponentType::F32
            && !accessor.normalized
        {
            return Err(format!(
                "{what}: accessor {} holds integers: they must be normalized",
                index.value()
            ));
        }
        let clamped = |color: Vec4| color.clamp(Vec4::ZERO, Vec4::ONE);
        Ok(match is_rgb {
            true => {
                let numbers = self.numbers(index, Type::Vec3, &what)?;
                let triples = numbers.as_chunks().0.iter();
                let opaque = |rgb: &[f32; 3]| clamped(Vec3::from(*rgb).extend(1.0));
                triples.map(opaque).collect()
            }
            false => {
                let numbers = self.numbers(index, Type::Vec4, &what)?;
                let fours = numbers.as_chunks().0.iter();
                fours
                    .map(|rgba: &[f32; 4]| clamped(Vec4::from(*rgba)))
                    .collect()
            }
        })
    }

    /// All indices of an accessor.
    pub(super) fn indices(&self, index: Index<Accessor>, what: &str) -> Result<Vec<u32>, Refusal> {
        let (accessor, what) = self.accessor(index, Type::Scalar, what)?;
        let component = component(accessor, &what)?;
        if !matches!(
            component,
            ComponentType::U8 | ComponentType::U16 | ComponentType::U32
        ) {
            return Err(format!(
                "{what}: its indices are {component:?}: they must be unsigned"
            ));
        }
        if accessor.sparse.is_some() {
            return Err(format!("{what}: its indices are sparse, which is not read"));
        }
        let count = count(accessor, &what)?;
        let elements = self.elements(accessor, size(component), count, &what)?;
        let elements =
            elements.ok_or_else(|| format!("{what}: its indices have no buffer view"))?;
        let places = (0..count).map(|i| integer(&elements.bytes[i * elements.stride..], component));
        Ok(places.collect())
    }

    fn accessor(
        &self,
        index: Index<Accessor>,
        wanted: Type,
        what: &str,
    ) -> Result<(&Accessor, String), Refusal> {
        let place = index.value();
        let accessor = find(
            &self.root.accessors,
            place,
            format_args!("{what}: accessor"),
        )?;
        let what = format!("{what}: accessor {place}");
        let unknown = || format!("{what} has no type that glTF knows");
        let found = known(&accessor.type_, unknown)?;
        match found == wanted {
            true => Ok((accessor, what)),
            false => Err(format!("{what} holds {found:?}: it must hold {wanted:?}")),
        }
    }

    /// The elements of an accessor; `None` if it has no buffer view, which means that all are 0.
    fn elements(
        &self,
        accessor: &Accessor,
        bytes: usize,
        count: usize,
        what: &str,
    ) -> Result<Option<Elements<'_>>, Refusal> {
        let Some(index) = accessor.buffer_view else {
            // A limit, so that a file of a few bytes cannot fill memory.
            return match count <= ZEROS_MAX {
                true => Ok(None),
                false => Err(format!("{what} has {count} elements and no buffer view")),
            };
        };
        let view = self.view(index, what)?;
        let stride = self.root.buffer_views[index.value()].byte_stride;
        let stride = stride.map_or(bytes, |stride| stride.0);
        let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
        let elements = part(view, offset, stride, bytes, count);
        let elements = elements.ok_or_else(|| {
            format!(
                "{what}: {count} elements of {bytes} bytes each {stride} bytes from byte {offset} on are more than \
                 the {} of its buffer view",
                view.len()
            )
        })?;
        Ok(Some(elements))
    }

    fn sparse_places(
        &self,
        sparse: &gltf_json::accessor::sparse::Sparse,
        count: usize,
        what: &str,
    ) -> Result<Vec<usize>, Refusal> {
        let unknown = || format!("{what}: its sparse indices have no type");
        let component = known(&sparse.indices.component_type, unknown)?.0;
        let view = self.view(sparse.indices.buffer_view, what)?;
        let bytes = size(component);
        let places = part(view, sparse.indices.byte_offset.0, bytes, bytes, count);
        let places = places.ok_or_else(|| format!("{what}: its sparse indices are cut off"))?;
        let places = (0..count).map(|i| integer(&places.bytes[i * bytes..], component) as usize);
        Ok(places.collect())
    }
}

impl Elements<'_> {
    fn decode(&self, numbers: &mut [f32], size: usize, decode: impl Fn(&[u8]) -> f32) {
        let count = self.bytes.len().div_ceil(self.stride.max(1));
        let width = numbers.len() / count.max(1);
        for (element, numbers) in numbers.chunks_mut(width.max(1)).enumerate() {
            let bytes = &self.bytes[element * self.stride..];
            for (component, number) in numbers.iter_mut().enumerate() {
                *number = decode(&bytes[component * size..]);
            }
        }
    }
}

/// Maximum number of elements of an accessor without a buffer view.
const ZEROS_MAX: usize = 1 << 20;

/// The elements in a part of a view; `None` if they do not fit.
fn part(
    view: &[u8],
    offset: u64,
    stride: usize,
    bytes: usize,
    count: usize,
) -> Option<Elements<'_>> {
    if count == 0 || stride < bytes {
        return None;
    }
    let offset = usize::try_from(offset).ok()?;
    // The last element need not be padded to the stride.
    let length = (count - 1).checked_mul(stride)?.checked_add(bytes)?;
    let bytes = view.get(offset..offset.checked_add(length)?)?;
    Some(Elements { bytes, stride })
}

fn count(accessor: &Accessor, what: &str) -> Result<usize, Refusal> {
    let count = accessor.count.0;
    let max = VERTICES_MAX;
    match usize::try_from(count) {
        Ok(count) if (1..=max).contains(&count) => Ok(count),
        _ => Err(format!(
            "{what} has {count} elements: it must have from 1 to {max}"
        )),
    }
}

fn component(accessor: &Accessor, what: &str) -> Result<ComponentType, Refusal> {
    let unknown = || format!("{what} has no component type that glTF knows");
    Ok(known(&accessor.component_type, unknown)?.0)
}

const fn components(of: Type) -> usize {
    match of {
        Type::Scalar => 1,
        Type::Vec2 => 2,
        Type::Vec3 => 3,
        Type::Vec4 | Type::Mat2 => 4,
        Type::Mat3 => 9,
        Type::Mat4 => 16,
    }
}

const fn size(component: ComponentType) -> usize {
    match component {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.first_chunk().copied().unwrap_or([0; N])
}

fn integer(bytes: &[u8], component: ComponentType) -> u32 {
    match component {
        ComponentType::I8 | ComponentType::U8 => u32::from(first::<1>(bytes)[0]),
        ComponentType::I16 | ComponentType::U16 => u32::from(u16::from_le_bytes(first(bytes))),
        ComponentType::U32 | ComponentType::F32 => u32::from_le_bytes(first(bytes)),
    }
}

/// Conversion of a component to f32 (section 3.11 of the specification).
fn number(bytes: &[u8], component: ComponentType, is_normalized: bool) -> f32 {
    let (value, whole) = match component {
        ComponentType::I8 => (f32::from(i8::from_le_bytes(first(bytes))), 127.0),
        ComponentType::U8 => (f32::from(first::<1>(bytes)[0]), 255.0),
        ComponentType::I16 => (f32::from(i16::from_le_bytes(first(bytes))), 32_767.0),
        ComponentType::U16 => (f32::from(u16::from_le_bytes(first(bytes))), 65_535.0),
        ComponentType::U32 => (u32::from_le_bytes(first(bytes)) as f32, 4_294_967_295.0),
        ComponentType::F32 => return f32::from_le_bytes(first(bytes)),
    };
    if is_normalized {
        // Two integers represent −1: −127 and −128, and likewise for 16 bits.
        (value / whole).max(-1.0)
    } else {
        value
    }
}
