//! Numbers side by side, as the sweeps compute with them: four contacts in one register, or one contact alone.
//!
//! A sweep waits for its own results: each contact needs the bodies that the one before has just changed. Four chains of
//! contacts that share no body (see `colouring`) wait together, in the lanes of one register.
//!
//! The choice is made when the program runs. With FMA a product and its sum are rounded together, without it one after
//! the other: the last digits of a sweep differ between the two kinds of processor, never between runs on one of them.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Four numbers in memory, where a register wants them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub struct Quad(pub [f64; 4]);

/// What lanes are loaded from, number by number.
pub trait Memory: Copy {
    const WIDTH: usize;

    fn filled(value: f64) -> Self;

    fn get(&self, lane: usize) -> f64;

    fn set(&mut self, lane: usize, value: f64);
}

impl Memory for f64 {
    const WIDTH: usize = 1;

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

impl Memory for Quad {
    const WIDTH: usize = 4;

    #[inline(always)]
    fn filled(value: f64) -> Self {
        Self([value; 4])
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

    fn splat(value: f64) -> Self;

    fn load(from: &Self::Memory) -> Self;

    fn store(self, to: &mut Self::Memory);

    /// self + x y
    fn plus_product(self, x: Self, y: Self) -> Self;

    /// Where self ≥ other; nowhere beside a NaN.
    fn at_least(self, other: Self) -> Self::Mask;

    fn both(x: Self::Mask, y: Self::Mask) -> Self::Mask;

    /// `yes` where the mask says so, self elsewhere.
    fn replaced(self, mask: Self::Mask, yes: Self) -> Self;

    /// Bit k tells lane k.
    fn bits(mask: Self::Mask) -> u32;

    #[inline(always)]
    fn finite(self) -> Self::Mask {
        let (most, least) = (Self::splat(f64::MAX), Self::splat(f64::MIN));
        Self::both(most.at_least(self), self.at_least(least))
    }

    #[inline(always)]
    fn all(mask: Self::Mask) -> bool {
        Self::bits(mask) == (1 << Self::Memory::WIDTH) - 1
    }
}

/// Four lanes, which can change places with four registers.
pub trait FourLanes: Lanes<Memory = Quad> {
    /// Entry k of lane l becomes entry l of lane k.
    fn transposed(rows: [Self; 4]) -> [Self; 4];
}

impl Lanes for f64 {
    type Memory = f64;
    type Mask = bool;

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

/// Four lanes for any processor.
#[derive(Clone, Copy)]
pub struct Portable([f64; 4]);

macro_rules! portable_operator {
    ($name:ident, $method:ident) => {
        impl $name for Portable {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut result = self.0;
                for k in 0..4 {
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
        Self([-self.0[0], -self.0[1], -self.0[2], -self.0[3]])
    }
}

impl Lanes for Portable {
    type Memory = Quad;
    type Mask = [bool; 4];

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; 4])
    }

    #[inline(always)]
    fn load(from: &Quad) -> Self {
        Self(from.0)
    }

    #[inline(always)]
    fn store(self, to: &mut Quad) {
        to.0 = self.0;
    }

    #[inline(always)]
    fn plus_product(self, x: Self, y: Self) -> Self {
        self + x * y
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> [bool; 4] {
        let mut mask = [false; 4];
        for k in 0..4 {
            mask[k] = self.0[k] >= other.0[k];
        }
        mask
    }

    #[inline(always)]
    fn both(x: [bool; 4], y: [bool; 4]) -> [bool; 4] {
        [x[0] & y[0], x[1] & y[1], x[2] & y[2], x[3] & y[3]]
    }

    #[inline(always)]
    fn replaced(self, mask: [bool; 4], yes: Self) -> Self {
        let mut result = self.0;
        for k in 0..4 {
            if mask[k] {
                result[k] = yes.0[k];
            }
        }
        Self(result)
    }

    #[inline(always)]
    fn bits(mask: [bool; 4]) -> u32 {
        u32::from(mask[0])
            | u32::from(mask[1]) << 1
            | u32::from(mask[2]) << 2
            | u32::from(mask[3]) << 3
    }
}

impl FourLanes for Portable {
    #[inline(always)]
    fn transposed(rows: [Self; 4]) -> [Self; 4] {
        let mut columns = [Self([0.0; 4]); 4];
        for k in 0..4 {
            for l in 0..4 {
                columns[k].0[l] = rows[l].0[k];
            }
        }
        columns
    }
}

#[cfg(target_arch = "x86_64")]
pub use fused::Fused;

#[cfg(target_arch = "x86_64")]
mod fused {
    use std::arch::x86_64::*;
    use std::ops::{Add, Div, Mul, Neg, Sub};

    use super::{FourLanes, Lanes, Quad};

    /// For processors with AVX2 and FMA: use it only inside a function compiled for them, once `available` has said yes.
    #[derive(Clone, Copy)]
    pub struct Fused(__m256d);

    impl Fused {
        pub fn available() -> bool {
            is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
        }
    }

    // SAFETY, of every block below: the instructions exist, as the type's users have made sure, and a Quad is 32 bytes
    // long and aligned to as many.
    macro_rules! fused_operator {
        ($name:ident, $method:ident, $instruction:ident) => {
            impl $name for Fused {
                type Output = Self;

                #[inline(always)]
                fn $method(self, other: Self) -> Self {
                    Self(unsafe { $instruction(self.0, other.0) })
                }
            }
        };
    }

    fused_operator!(Add, add, _mm256_add_pd);
    fused_operator!(Sub, sub, _mm256_sub_pd);
    fused_operator!(Mul, mul, _mm256_mul_pd);
    fused_operator!(Div, div, _mm256_div_pd);

    impl Neg for Fused {
        type Output = Self;

        #[inline(always)]
        fn neg(self) -> Self {
            Self(unsafe { _mm256_xor_pd(self.0, _mm256_set1_pd(-0.0)) })
        }
    }

    impl Lanes for Fused {
        type Memory = Quad;
        type Mask = __m256d;

        #[inline(always)]
        fn splat(value: f64) -> Self {
            Self(unsafe { _mm256_set1_pd(value) })
        }

        #[inline(always)]
        fn load(from: &Quad) -> Self {
            Self(unsafe { _mm256_load_pd(from.0.as_ptr()) })
        }

        #[inline(always)]
        fn store(self, to: &mut Quad) {
            unsafe { _mm256_store_pd(to.0.as_mut_ptr(), self.0) }
        }

        #[inline(always)]
        fn plus_product(self, x: Self, y: Self) -> Self {
            Self(unsafe { _mm256_fmadd_pd(x.0, y.0, self.0) })
        }

        #[inline(always)]
        fn at_least(self, other: Self) -> __m256d {
            unsafe { _mm256_cmp_pd::<_CMP_GE_OQ>(self.0, other.0) }
        }

        #[inline(always)]
        fn both(x: __m256d, y: __m256d) -> __m256d {
            unsafe { _mm256_and_pd(x, y) }
        }

        #[inline(always)]
        fn replaced(self, mask: __m256d, yes: Self) -> Self {
            Self(unsafe { _mm256_blendv_pd(self.0, yes.0, mask) })
        }

        #[inline(always)]
        fn bits(mask: __m256d) -> u32 {
            unsafe { _mm256_movemask_pd(mask) as u32 }
        }
    }

    impl FourLanes for Fused {
        #[inline(always)]
        fn transposed([a, b, c, d]: [Self; 4]) -> [Self; 4] {
            unsafe {
                let (low_ab, high_ab) =
                    (_mm256_unpacklo_pd(a.0, b.0), _mm256_unpackhi_pd(a.0, b.0));
                let (low_cd, high_cd) =
                    (_mm256_unpacklo_pd(c.0, d.0), _mm256_unpackhi_pd(c.0, d.0));
                [
                    Self(_mm256_permute2f128_pd::<0x20>(low_ab, low_cd)),
                    Self(_mm256_permute2f128_pd::<0x20>(high_ab, high_cd)),
                    Self(_mm256_permute2f128_pd::<0x31>(low_ab, low_cd)),
                    Self(_mm256_permute2f128_pd::<0x31>(high_ab, high_cd)),
                ]
            }
        }
    }
}
