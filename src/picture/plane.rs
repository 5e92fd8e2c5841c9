//! Memory of one value per pixel that begins at a line of the caches.

use bytemuck::Pod;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

/// Bytes of a line of the caches.
const LINE: usize = 64;

/// What the memory is asked for in.
type Word = u64;

/// Values of pixels, row-major, as a slice. The first begins a line of the caches, and so does that of each row where lines divide the
/// rows: vectors are stored to one line each then and not across two. The values' size divides 8 bytes.
pub struct Plane<T> {
    /// Seven words more than the values take, so that a line begins within. An array of lines would be aligned by itself, but its
    /// memory would be written as it is made: this one's pages are made by the threads that first write to them.
    memory: Vec<Word>,
    /// The first that is used.
    first: usize,
    len: usize,
    values: PhantomData<T>,
}

impl<T: Pod> Plane<T> {
    /// `len` values of zero bytes.
    pub fn new(len: usize) -> Self {
        const MORE: usize = LINE / size_of::<Word>() - 1;
        const { assert!(size_of::<T>() > 0 && size_of::<Word>().is_multiple_of(size_of::<T>())) };
        let memory = vec![0; (len * size_of::<T>()).div_ceil(size_of::<Word>()) + MORE];
        // It stays where it is: a vector that does not grow does not move.
        let first = memory.as_ptr().align_offset(LINE).min(MORE);
        Self { memory, first, len, values: PhantomData }
    }

    /// `len` times the same value.
    pub fn filled(value: T, len: usize) -> Self {
        let mut plane = Self::new(len);
        plane.fill(value);
        plane
    }
}

impl<T: Pod> Deref for Plane<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        &bytemuck::cast_slice(&self.memory[self.first..])[..self.len]
    }
}

impl<T: Pod> DerefMut for Plane<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut bytemuck::cast_slice_mut(&mut self.memory[self.first..])[..self.len]
    }
}

impl<T: Pod> Clone for Plane<T> {
    fn clone(&self) -> Self {
        Self::from(&self[..])
    }
}

impl<T: Pod> From<&[T]> for Plane<T> {
    fn from(values: &[T]) -> Self {
        let mut plane = Self::new(values.len());
        plane.copy_from_slice(values);
        plane
    }
}

impl<T: Pod, const N: usize> From<[T; N]> for Plane<T> {
    fn from(values: [T; N]) -> Self {
        Self::from(&values[..])
    }
}

impl<T: Pod> From<Vec<T>> for Plane<T> {
    fn from(values: Vec<T>) -> Self {
        Self::from(&values[..])
    }
}

impl<T: Pod> FromIterator<T> for Plane<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        Self::from(values.into_iter().collect::<Vec<_>>())
    }
}

impl<'a, T: Pod> IntoIterator for &'a Plane<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<'a, T: Pod> IntoIterator for &'a mut Plane<T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter_mut()
    }
}

impl<T: Pod + PartialEq> PartialEq for Plane<T> {
    fn eq(&self, other: &Self) -> bool {
        self[..] == other[..]
    }
}

impl<T: Pod + Eq> Eq for Plane<T> {}

impl<T: Pod + fmt::Debug> fmt::Debug for Plane<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self[..].fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_begin_at_lines_and_hold_what_they_are_given() {
        for len in [0, 1, 15, 16, 17, 1000] {
            let values: Vec<f32> = (0..len).map(|i| i as f32).collect();
            let mut plane = Plane::from(values.clone());
            assert_eq!(plane[..], values[..]);
            assert!(len == 0 || plane.as_ptr().addr().is_multiple_of(64));
            assert_eq!(plane, values.iter().copied().collect());
            let copy = plane.clone();
            assert!(copy == plane && (len == 0 || copy.as_ptr().addr().is_multiple_of(64)));
            plane.iter_mut().for_each(|value| *value += 1.0);
            assert!(plane.iter().zip(&values).all(|(a, b)| *a == b + 1.0));
            assert_eq!(Plane::<[u8; 4]>::new(len)[..], vec![[0; 4]; len][..]);
        }
        assert_ne!(Plane::from([1.0, 2.0]), Plane::from([1.0]));
        assert_eq!(format!("{:?}", Plane::from([[1u8, 2, 3, 4]])), "[[1, 2, 3, 4]]");
    }
}
