//! Two numbers side by side, as the sweeps read bodies and Jacobians: in one register, with fused products where there are.
//!
//! A sweep waits for its own results: each contact needs the bodies that the one before has just changed. Two lanes are
//! then faster than four, because their sum never crosses the halves of a register, and a body of six fills three pairs.
//!
//! The choice is made when the program runs. With FMA a product and its sum are rounded together, without it one after
//! the other: the last digits of a sweep differ between the two kinds of processor, never between runs on one of them.

/// Two numbers in memory, where a register wants them.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(16))]
pub struct Pair(pub [f64; 2]);

/// Two numbers in a register.
///
/// Never used inside a closure: a closure is compiled apart from the function around it, for the plain processor.
pub trait Lanes: Copy {
    /// `value` in both places.
    fn splat(value: f64) -> Self;

    /// `value` in the first place, zero in the other.
    fn lone(value: f64) -> Self;

    fn load(from: &Pair) -> Self;

    fn store(self, to: &mut Pair);

    fn plus(self, other: Self) -> Self;

    fn times(self, other: Self) -> Self;

    /// self + x y
    fn plus_product(self, x: Self, y: Self) -> Self;

    /// The sum of the two, in both places.
    fn sum(self) -> Self;

    /// The number in the first place.
    fn first(self) -> f64;
}

/// For any processor.
#[derive(Clone, Copy)]
pub struct Portable([f64; 2]);

impl Lanes for Portable {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; 2])
    }

    #[inline(always)]
    fn lone(value: f64) -> Self {
        Self([value, 0.0])
    }

    #[inline(always)]
    fn load(from: &Pair) -> Self {
        Self(from.0)
    }

    #[inline(always)]
    fn store(self, to: &mut Pair) {
        to.0 = self.0;
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        Self([self.0[0] * other.0[0], self.0[1] * other.0[1]])
    }

    #[inline(always)]
    fn plus_product(self, x: Self, y: Self) -> Self {
        self.plus(x.times(y))
    }

    #[inline(always)]
    fn sum(self) -> Self {
        Self::splat(self.0[0] + self.0[1])
    }

    #[inline(always)]
    fn first(self) -> f64 {
        self.0[0]
    }
}

#[cfg(target_arch = "x86_64")]
pub use fused::Fused;

#[cfg(target_arch = "x86_64")]
mod fused {
    use std::arch::x86_64::*;

    use super::{Lanes, Pair};

    /// For processors with FMA: use it only inside a function compiled for it, once `available` has said yes.
    #[derive(Clone, Copy)]
    pub struct Fused(__m128d);

    impl Fused {
        pub fn available() -> bool {
            is_x86_feature_detected!("fma")
        }
    }

    // SAFETY, of every block below: the instructions exist, as the type's users have made sure, and a Pair is 16 bytes
    // long and aligned to as many.
    impl Lanes for Fused {
        #[inline(always)]
        fn splat(value: f64) -> Self {
            Self(unsafe { _mm_set1_pd(value) })
        }

        #[inline(always)]
        fn lone(value: f64) -> Self {
            Self(unsafe { _mm_set_sd(value) })
        }

        #[inline(always)]
        fn load(from: &Pair) -> Self {
            Self(unsafe { _mm_load_pd(from.0.as_ptr()) })
        }

        #[inline(always)]
        fn store(self, to: &mut Pair) {
            unsafe { _mm_store_pd(to.0.as_mut_ptr(), self.0) }
        }

        #[inline(always)]
        fn plus(self, other: Self) -> Self {
            Self(unsafe { _mm_add_pd(self.0, other.0) })
        }

        #[inline(always)]
        fn times(self, other: Self) -> Self {
            Self(unsafe { _mm_mul_pd(self.0, other.0) })
        }

        #[inline(always)]
        fn plus_product(self, x: Self, y: Self) -> Self {
            Self(unsafe { _mm_fmadd_pd(x.0, y.0, self.0) })
        }

        #[inline(always)]
        fn sum(self) -> Self {
            Self(unsafe { _mm_add_pd(self.0, _mm_shuffle_pd::<1>(self.0, self.0)) })
        }

        #[inline(always)]
        fn first(self) -> f64 {
            unsafe { _mm_cvtsd_f64(self.0) }
        }
    }
}
