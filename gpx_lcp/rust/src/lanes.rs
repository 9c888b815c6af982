//! Numbers side by side, as the sweeps compute with them: eight contacts at once, four of eight, or one contact alone.
//!
//! A sweep waits for its own results: each contact needs the bodies that the one before has just changed. Eight chains of
//! contacts that share no body (see `colouring`) wait together, in the lanes of one register; or four, and then the other
//! four, where registers are half as wide.
//!
//! The choice is made when the program runs. With FMA a product and its sum are rounded together, without it one after
//! the other, and the direction of a contact's friction follows while any contact of its register slides: the last digits of
//! a sweep differ between kinds of processor, never between runs on one of them.

use std::ops::{Add, Div, Mul, Neg, Range, Sub};

#[cfg(target_arch = "x86_64")]
pub mod x86_64;

/// Contacts that are visited side by side.
pub const LANES: usize = 8;

/// A number for each lane in memory, where a register wants them: a line of the cache.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(64))]
pub struct Oct(pub [f64; LANES]);

/// What lanes are loaded from, number by number.
pub trait Memory: Copy {
    fn filled(value: f64) -> Self;

    fn get(&self, lane: usize) -> f64;

    fn set(&mut self, lane: usize, value: f64);
}

impl Memory for f64 {
    #[inline(always)]
    fn filled(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn get(&self, _lane: usize) -> f64 {
        *self
    }

    #[inline(always)]
    fn set(&mut self, _lane: usize, value: f64) {
        *self = value;
    }
}

impl Memory for Oct {
    #[inline(always)]
    fn filled(value: f64) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> f64 {
        self.0[lane]
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, value: f64) {
        self.0[lane] = value;
    }
}

/// Numbers in a register.
///
/// Never used inside a closure: a closure is compiled apart from the function around it, for the plain processor.
pub trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    type Memory: Memory;
    /// Yes or no in each lane.
    type Mask: Copy;
    /// Which numbers of its memory a register holds.
    const HELD: Range<usize>;

    fn splat(value: f64) -> Self;

    fn load(from: &Self::Memory) -> Self;

    fn store(self, to: &mut Self::Memory);

    /// self + x y
    fn plus_product(self, x: Self, y: Self) -> Self;

    /// self - x y
    fn minus_product(self, x: Self, y: Self) -> Self;

    fn sqrt(self) -> Self;

    /// Where self ≥ other; nowhere beside a NaN.
    fn at_least(self, other: Self) -> Self::Mask;

    fn both(x: Self::Mask, y: Self::Mask) -> Self::Mask;

    /// `yes` where the mask says so, self elsewhere.
    fn replaced(self, mask: Self::Mask, yes: Self) -> Self;

    /// Bit k tells number k of the memory; zero where it is not held.
    fn bits(mask: Self::Mask) -> u32;

    #[inline(always)]
    fn finite(self) -> Self::Mask {
        let (most, least) = (Self::splat(f64::MAX), Self::splat(f64::MIN));
        Self::both(most.at_least(self), self.at_least(least))
    }

    /// The bits of all that is held.
    const ALL: u32 = (1 << Self::HELD.end) - (1 << Self::HELD.start);

    #[inline(always)]
    fn all(mask: Self::Mask) -> bool {
        Self::bits(mask) == Self::ALL
    }
}

/// Lanes of an Oct, which can be filled from an Oct each.
pub trait OctLanes: Lanes<Memory = Oct> {
    /// Entry k of the Oct of each lane that is held, for all k.
    ///
    /// # Safety
    /// The Octs of the lanes that are held may be read.
    unsafe fn gathered(from: &[*mut Oct; LANES]) -> [Self; LANES];

    /// The way back.
    ///
    /// # Safety
    /// The Octs of the lanes that are held are the caller's to write, one after the other.
    unsafe fn scatter(entries: &[Self; LANES], to: &[*mut Oct; LANES]);
}

impl Lanes for f64 {
    type Memory = f64;
    type Mask = bool;
    const HELD: Range<usize> = 0..1;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn load(from: &f64) -> Self {
        *from
    }

    #[inline(always)]
    fn store(self, to: &mut f64) {
        *to = self;
    }

    #[inline(always)]
    fn plus_product(self, x: Self, y: Self) -> Self {
        self + x * y
    }

    #[inline(always)]
    fn minus_product(self, x: f64, y: f64) -> Self {
        self - x * y
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> bool {
        self >= other
    }

    #[inline(always)]
    fn both(x: bool, y: bool) -> bool {
        x & y
    }

    #[inline(always)]
    fn replaced(self, mask: bool, yes: Self) -> Self {
        if mask { yes } else { self }
    }

    #[inline(always)]
    fn bits(mask: bool) -> u32 {
        u32::from(mask)
    }
}

/// Eight lanes for any processor.
#[derive(Clone, Copy)]
pub struct Portable([f64; LANES]);

macro_rules! portable_operator {
    ($name:ident, $method:ident) => {
        impl $name for Portable {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut result = self.0;
                for k in 0..LANES {
                    result[k] = result[k].$method(other.0[k]);
                }
                Self(result)
            }
        }
    };
}

portable_operator!(Add, add);
portable_operator!(Sub, sub);
portable_operator!(Mul, mul);
portable_operator!(Div, div);

impl Neg for Portable {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let mut result = self.0;
        for value in &mut result {
            *value = -*value;
        }
        Self(result)
    }
}

impl Lanes for Portable {
    type Memory = Oct;
    type Mask = [bool; LANES];
    const HELD: Range<usize> = 0..LANES;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn load(from: &Oct) -> Self {
        Self(from.0)
    }

    #[inline(always)]
    fn store(self, to: &mut Oct) {
        to.0 = self.0;
    }

    #[inline(always)]
    fn plus_product(self, x: Self, y: Self) -> Self {
        self + x * y
    }

    #[inline(always)]
    fn minus_product(self, x: Self, y: Self) -> Self {
        self - x * y
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let mut result = self.0;
        for value in &mut result {
            *value = value.sqrt();
        }
        Self(result)
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> [bool; LANES] {
        let mut mask = [false; LANES];
        for k in 0..LANES {
            mask[k] = self.0[k] >= other.0[k];
        }
        mask
    }

    #[inline(always)]
    fn both(x: [bool; LANES], y: [bool; LANES]) -> [bool; LANES] {
        let mut mask = x;
        for k in 0..LANES {
            mask[k] &= y[k];
        }
        mask
    }

    #[inline(always)]
    fn replaced(self, mask: [bool; LANES], yes: Self) -> Self {
        let mut result = self.0;
        for k in 0..LANES {
            if mask[k] {
                result[k] = yes.0[k];
            }
        }
        Self(result)
    }

    #[inline(always)]
    fn bits(mask: [bool; LANES]) -> u32 {
        let mut bits = 0;
        for k in 0..LANES {
            bits |= u32::from(mask[k]) << k;
        }
        bits
    }
}

impl OctLanes for Portable {
    #[inline(always)]
    unsafe fn gathered(from: &[*mut Oct; LANES]) -> [Self; LANES] {
        let mut entries = [Self([0.0; LANES]); LANES];
        for lane in 0..LANES {
            // SAFETY: the caller's promise.
            let values = unsafe { (*from[lane]).0 };
            for k in 0..LANES {
                entries[k].0[lane] = values[k];
            }
        }
        entries
    }

    #[inline(always)]
    unsafe fn scatter(entries: &[Self; LANES], to: &[*mut Oct; LANES]) {
        for lane in 0..LANES {
            let mut values = [0.0; LANES];
            for k in 0..LANES {
                values[k] = entries[k].0[lane];
            }
            // SAFETY: the caller's promise.
            unsafe { (*to[lane]).0 = values };
        }
    }
}
