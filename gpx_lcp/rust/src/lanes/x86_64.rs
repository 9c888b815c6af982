//! Eight lanes in the registers of x86-64: two of AVX2, or one of AVX-512. Both round alike.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{EightLanes, LANES, Lanes, Oct};

/// For processors with AVX2 and FMA: use it only inside a function compiled for them, once `available` has said yes.
#[derive(Clone, Copy)]
pub struct Pair([__m256d; 2]);

/// The same for processors with AVX-512.
#[derive(Clone, Copy)]
pub struct Wide(__m512d);

impl Pair {
    pub fn available() -> bool {
        is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
    }
}

impl Wide {
    pub fn available() -> bool {
        is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq")
    }
}

// SAFETY, of every block below: the instructions exist, as the types' users have made sure, and an Oct is 64 bytes long
// and aligned to as many.
macro_rules! operator {
    ($name:ident, $method:ident, $half:ident, $whole:ident) => {
        impl $name for Pair {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let ([a, b], [c, d]) = (self.0, other.0);
                Self(unsafe { [$half(a, c), $half(b, d)] })
            }
        }

        impl $name for Wide {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(unsafe { $whole(self.0, other.0) })
            }
        }
    };
}

operator!(Add, add, _mm256_add_pd, _mm512_add_pd);
operator!(Sub, sub, _mm256_sub_pd, _mm512_sub_pd);
operator!(Mul, mul, _mm256_mul_pd, _mm512_mul_pd);
operator!(Div, div, _mm256_div_pd, _mm512_div_pd);

impl Neg for Pair {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let ([a, b], sign) = (self.0, unsafe { _mm256_set1_pd(-0.0) });
        Self(unsafe { [_mm256_xor_pd(a, sign), _mm256_xor_pd(b, sign)] })
    }
}

impl Neg for Wide {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(unsafe { _mm512_xor_pd(self.0, _mm512_set1_pd(-0.0)) })
    }
}

impl Lanes for Pair {
    type Memory = Oct;
    type Mask = [__m256d; 2];

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(unsafe { [_mm256_set1_pd(value); 2] })
    }

    #[inline(always)]
    fn load(from: &Oct) -> Self {
        let first = from.0.as_ptr();
        Self(unsafe { [_mm256_load_pd(first), _mm256_load_pd(first.add(4))] })
    }

    #[inline(always)]
    fn store(self, to: &mut Oct) {
        let first = to.0.as_mut_ptr();
        unsafe {
            _mm256_store_pd(first, self.0[0]);
            _mm256_store_pd(first.add(4), self.0[1]);
        }
    }

    #[inline(always)]
    fn plus_product(self, x: Self, y: Self) -> Self {
        let ([a, b], [c, d], [e, f]) = (self.0, x.0, y.0);
        Self(unsafe { [_mm256_fmadd_pd(c, e, a), _mm256_fmadd_pd(d, f, b)] })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let [a, b] = self.0;
        Self(unsafe { [_mm256_sqrt_pd(a), _mm256_sqrt_pd(b)] })
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> Self::Mask {
        let ([a, b], [c, d]) = (self.0, other.0);
        unsafe {
            [
                _mm256_cmp_pd::<_CMP_GE_OQ>(a, c),
                _mm256_cmp_pd::<_CMP_GE_OQ>(b, d),
            ]
        }
    }

    #[inline(always)]
    fn both([a, b]: Self::Mask, [c, d]: Self::Mask) -> Self::Mask {
        unsafe { [_mm256_and_pd(a, c), _mm256_and_pd(b, d)] }
    }

    #[inline(always)]
    fn replaced(self, [first, second]: Self::Mask, yes: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, yes.0);
        Self(unsafe {
            [
                _mm256_blendv_pd(a, c, first),
                _mm256_blendv_pd(b, d, second),
            ]
        })
    }

    #[inline(always)]
    fn bits([first, second]: Self::Mask) -> u32 {
        unsafe { (_mm256_movemask_pd(first) | _mm256_movemask_pd(second) << 4) as u32 }
    }
}

impl Lanes for Wide {
    type Memory = Oct;
    type Mask = __mmask8;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(unsafe { _mm512_set1_pd(value) })
    }

    #[inline(always)]
    fn load(from: &Oct) -> Self {
        Self(unsafe { _mm512_load_pd(from.0.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut Oct) {
        unsafe { _mm512_store_pd(to.0.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn plus_product(self, x: Self, y: Self) -> Self {
        Self(unsafe { _mm512_fmadd_pd(x.0, y.0, self.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(unsafe { _mm512_sqrt_pd(self.0) })
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> Self::Mask {
        unsafe { _mm512_cmp_pd_mask::<_CMP_GE_OQ>(self.0, other.0) }
    }

    #[inline(always)]
    fn both(x: Self::Mask, y: Self::Mask) -> Self::Mask {
        x & y
    }

    #[inline(always)]
    fn replaced(self, mask: Self::Mask, yes: Self) -> Self {
        Self(unsafe { _mm512_mask_blend_pd(mask, self.0, yes.0) })
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        u32::from(mask)
    }
}

impl EightLanes for Pair {
    /// Four squares of four.
    #[inline(always)]
    fn transposed(rows: [Self; LANES]) -> [Self; LANES] {
        let [a, b, c, d, e, f, g, h] = rows;
        let mut columns = rows;
        for half in 0..2 {
            let first = four_transposed([a.0[half], b.0[half], c.0[half], d.0[half]]);
            let second = four_transposed([e.0[half], f.0[half], g.0[half], h.0[half]]);
            for k in 0..4 {
                columns[4 * half + k] = Self([first[k], second[k]]);
            }
        }
        columns
    }
}

#[inline(always)]
fn four_transposed([a, b, c, d]: [__m256d; 4]) -> [__m256d; 4] {
    unsafe {
        let (low_ab, high_ab) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
        let (low_cd, high_cd) = (_mm256_unpacklo_pd(c, d), _mm256_unpackhi_pd(c, d));
        [
            _mm256_permute2f128_pd::<0x20>(low_ab, low_cd),
            _mm256_permute2f128_pd::<0x20>(high_ab, high_cd),
            _mm256_permute2f128_pd::<0x31>(low_ab, low_cd),
            _mm256_permute2f128_pd::<0x31>(high_ab, high_cd),
        ]
    }
}

impl EightLanes for Wide {
    /// Pairs of entries first; then the pairs, as entries of a square of four.
    #[inline(always)]
    fn transposed([a, b, c, d, e, f, g, h]: [Self; LANES]) -> [Self; LANES] {
        let even = unsafe {
            pairs_transposed([
                _mm512_unpacklo_pd(a.0, b.0),
                _mm512_unpacklo_pd(c.0, d.0),
                _mm512_unpacklo_pd(e.0, f.0),
                _mm512_unpacklo_pd(g.0, h.0),
            ])
        };
        let odd = unsafe {
            pairs_transposed([
                _mm512_unpackhi_pd(a.0, b.0),
                _mm512_unpackhi_pd(c.0, d.0),
                _mm512_unpackhi_pd(e.0, f.0),
                _mm512_unpackhi_pd(g.0, h.0),
            ])
        };
        let mut columns = [a; LANES];
        for k in 0..4 {
            columns[2 * k] = Self(even[k]);
            columns[2 * k + 1] = Self(odd[k]);
        }
        columns
    }
}

#[inline(always)]
fn pairs_transposed([a, b, c, d]: [__m512d; 4]) -> [__m512d; 4] {
    unsafe {
        let (low_ab, high_ab) = (
            _mm512_shuffle_f64x2::<0x44>(a, b),
            _mm512_shuffle_f64x2::<0xee>(a, b),
        );
        let (low_cd, high_cd) = (
            _mm512_shuffle_f64x2::<0x44>(c, d),
            _mm512_shuffle_f64x2::<0xee>(c, d),
        );
        [
            _mm512_shuffle_f64x2::<0x88>(low_ab, low_cd),
            _mm512_shuffle_f64x2::<0xdd>(low_ab, low_cd),
            _mm512_shuffle_f64x2::<0x88>(high_ab, high_cd),
            _mm512_shuffle_f64x2::<0xdd>(high_ab, high_cd),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Portable;

    /// Entries 10 k + l, turned, must be 10 l + k; and every operation must do lane by lane what a number does.
    #[inline(always)]
    fn check<V: EightLanes>() {
        let mut rows = [V::splat(0.0); LANES];
        for k in 0..LANES {
            let mut memory = Oct::default();
            for l in 0..LANES {
                memory.0[l] = (10 * k + l) as f64;
            }
            rows[k] = V::load(&memory);
        }
        let columns = V::transposed(rows);
        let mut memory = Oct::default();
        for k in 0..LANES {
            columns[k].store(&mut memory);
            for l in 0..LANES {
                assert_eq!(memory.0[l], (10 * l + k) as f64);
            }
        }
        let x = Oct([-2.0, -1.0, -0.0, 0.0, 1.0, 2.0, f64::NAN, 9.0]);
        let (a, b) = (V::load(&x), V::splat(1.0));
        assert_eq!(V::bits(a.at_least(b)), 0b1011_0000);
        let both = V::both(a.at_least(b), (-a).at_least(-b - b));
        assert_eq!(V::bits(both), 0b0011_0000);
        a.replaced(both, -b).store(&mut memory);
        assert_eq!(memory.0[..6], [-2.0, -1.0, 0.0, 0.0, -1.0, -1.0]);
        let two = (b + b + b + b).sqrt();
        two.plus_product(b, a).store(&mut memory);
        assert_eq!(memory.0[..6], [0.0, 1.0, 2.0, 2.0, 3.0, 4.0]);
        (a / two).store(&mut memory);
        assert_eq!(memory.0[..6], [-1.0, -0.5, 0.0, 0.0, 0.5, 1.0]);
    }

    #[target_feature(enable = "avx2,fma")]
    fn check_pair() {
        check::<Pair>();
    }

    #[target_feature(enable = "avx512f,avx512dq")]
    fn check_wide() {
        check::<Wide>();
    }

    #[test]
    fn every_kind_of_register_computes_as_numbers_do() {
        check::<Portable>();
        // SAFETY: the processor has just said that it has what is used.
        if Pair::available() {
            unsafe { check_pair() };
        }
        if Wide::available() {
            unsafe { check_wide() };
        }
    }
}
