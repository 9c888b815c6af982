//! Lanes in the registers of x86-64: eight in one of AVX-512, or four of eight in one of AVX2. Both round alike.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Range, Sub};

use super::{LANES, Lanes, Oct, OctLanes};

/// Half the lanes of an Oct, from lane FIRST on, for processors with AVX2 and FMA: use it only inside a function compiled
/// for them, once `has_quads` has said yes.
///
/// Two of them together would hold an Oct, but the states of two bodies are then more than there are registers.
#[derive(Clone, Copy)]
pub struct Quad<const FIRST: usize>(__m256d);

/// All lanes, for processors with AVX-512.
#[derive(Clone, Copy)]
pub struct Wide(__m512d);

pub fn has_quads() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
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
        impl<const FIRST: usize> $name for Quad<FIRST> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(unsafe { $half(self.0, other.0) })
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

impl<const FIRST: usize> Neg for Quad<FIRST> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(unsafe { _mm256_xor_pd(self.0, _mm256_set1_pd(-0.0)) })
    }
}

impl Neg for Wide {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(unsafe { _mm512_xor_pd(self.0, _mm512_set1_pd(-0.0)) })
    }
}

impl<const FIRST: usize> Lanes for Quad<FIRST> {
    type Memory = Oct;
    type Mask = __m256d;
    const HELD: Range<usize> = FIRST..FIRST + LANES / 2;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(unsafe { _mm256_set1_pd(value) })
    }

    #[inline(always)]
    fn load(from: &Oct) -> Self {
        Self(unsafe { _mm256_load_pd(from.0.as_ptr().add(FIRST)) })
    }

    #[inline(always)]
    fn store(self, to: &mut Oct) {
        unsafe { _mm256_store_pd(to.0.as_mut_ptr().add(FIRST), self.0) }
    }

    #[inline(always)]
    fn plus_product(self, x: Self, y: Self) -> Self {
        Self(unsafe { _mm256_fmadd_pd(x.0, y.0, self.0) })
    }

    #[inline(always)]
    fn minus_product(self, x: Self, y: Self) -> Self {
        Self(unsafe { _mm256_fnmadd_pd(x.0, y.0, self.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(unsafe { _mm256_sqrt_pd(self.0) })
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> Self::Mask {
        unsafe { _mm256_cmp_pd::<_CMP_GE_OQ>(self.0, other.0) }
    }

    #[inline(always)]
    fn both(x: Self::Mask, y: Self::Mask) -> Self::Mask {
        unsafe { _mm256_and_pd(x, y) }
    }

    #[inline(always)]
    fn replaced(self, mask: Self::Mask, yes: Self) -> Self {
        Self(unsafe { _mm256_blendv_pd(self.0, yes.0, mask) })
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        unsafe { (_mm256_movemask_pd(mask) as u32) << FIRST }
    }
}

impl Lanes for Wide {
    type Memory = Oct;
    type Mask = __mmask8;
    const HELD: Range<usize> = 0..LANES;

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
    fn minus_product(self, x: Self, y: Self) -> Self {
        Self(unsafe { _mm512_fnmadd_pd(x.0, y.0, self.0) })
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

impl<const FIRST: usize> OctLanes for Quad<FIRST> {
    /// Two squares of four.
    #[inline(always)]
    unsafe fn gathered(from: &[*mut Oct; LANES]) -> [Self; LANES] {
        let mut entries = [Self::splat(0.0); LANES];
        for first in [0, LANES / 2] {
            let mut square = [entries[0].0; 4];
            for k in 0..4 {
                square[k] = unsafe { _mm256_load_pd((*from[FIRST + k]).0.as_ptr().add(first)) };
            }
            square = four_transposed(square);
            for k in 0..4 {
                entries[first + k] = Self(square[k]);
            }
        }
        entries
    }

    #[inline(always)]
    unsafe fn scatter(entries: &[Self; LANES], to: &[*mut Oct; LANES]) {
        for first in [0, LANES / 2] {
            let mut square = [entries[0].0; 4];
            for k in 0..4 {
                square[k] = entries[first + k].0;
            }
            square = four_transposed(square);
            for k in 0..4 {
                unsafe { _mm256_store_pd((*to[FIRST + k]).0.as_mut_ptr().add(first), square[k]) };
            }
        }
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

impl OctLanes for Wide {
    #[inline(always)]
    unsafe fn gathered(from: &[*mut Oct; LANES]) -> [Self; LANES] {
        let mut rows = [Self::splat(0.0); LANES];
        for lane in 0..LANES {
            rows[lane] = Self::load(unsafe { &*from[lane] });
        }
        eight_transposed(&rows)
    }

    #[inline(always)]
    unsafe fn scatter(entries: &[Self; LANES], to: &[*mut Oct; LANES]) {
        let rows = eight_transposed(entries);
        for lane in 0..LANES {
            rows[lane].store(unsafe { &mut *to[lane] });
        }
    }
}

/// Pairs of entries first; then the pairs, as entries of a square of four.
#[inline(always)]
fn eight_transposed([a, b, c, d, e, f, g, h]: &[Wide; LANES]) -> [Wide; LANES] {
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
    let mut columns = [*a; LANES];
    for k in 0..4 {
        columns[2 * k] = Wide(even[k]);
        columns[2 * k + 1] = Wide(odd[k]);
    }
    columns
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

    /// Entry 10 l + k of the Oct of lane l must be found in lane l of entry k, and come back; and every operation must do
    /// lane by lane what a number does.
    #[inline(always)]
    fn check<V: OctLanes>() {
        let mut octs = [Oct::default(); LANES];
        for l in 0..LANES {
            for k in 0..LANES {
                octs[l].0[k] = (10 * l + k) as f64;
            }
        }
        let places = octs.each_mut().map(std::ptr::from_mut);
        // SAFETY: they are this function's own.
        let entries = unsafe { V::gathered(&places) };
        let mut memory = Oct([-1.0; LANES]);
        for k in 0..LANES {
            entries[k].store(&mut memory);
            for l in V::HELD {
                assert_eq!(memory.0[l], (10 * l + k) as f64);
            }
        }
        let mut doubled = entries;
        for k in 0..LANES {
            doubled[k] = entries[k] + entries[k];
        }
        // SAFETY: as above.
        unsafe { V::scatter(&doubled, &places) };
        for l in 0..LANES {
            let times = if V::HELD.contains(&l) { 2 } else { 1 };
            for k in 0..LANES {
                assert_eq!(octs[l].0[k], (times * (10 * l + k)) as f64);
            }
        }
        let x = Oct([-2.0, -1.0, -0.0, 0.0, 1.0, 2.0, f64::NAN, 9.0]);
        let (a, b) = (V::load(&x), V::splat(1.0));
        assert_eq!(V::bits(a.at_least(b)), 0b1011_0000 & V::ALL);
        let both = V::both(a.at_least(b), (-a).at_least(-b - b));
        assert_eq!(V::bits(both), 0b0011_0000 & V::ALL);
        assert_same::<V>(a.replaced(both, -b), [-2.0, -1.0, 0.0, 0.0, -1.0, -1.0]);
        let two = (b + b + b + b).sqrt();
        assert_same::<V>(two.plus_product(b, a), [0.0, 1.0, 2.0, 2.0, 3.0, 4.0]);
        assert_same::<V>(a.minus_product(two, b), [-4.0, -3.0, -2.0, -2.0, -1.0, 0.0]);
        assert_same::<V>(a / two, [-1.0, -0.5, 0.0, 0.0, 0.5, 1.0]);
    }

    #[inline(always)]
    fn assert_same<V: OctLanes>(found: V, wanted: [f64; 6]) {
        let mut memory = Oct::default();
        found.store(&mut memory);
        for (lane, wanted) in wanted.into_iter().enumerate() {
            if V::HELD.contains(&lane) {
                assert_eq!(memory.0[lane], wanted);
            }
        }
    }

    #[target_feature(enable = "avx2,fma")]
    fn check_quads() {
        check::<Quad<0>>();
        check::<Quad<4>>();
    }

    #[target_feature(enable = "avx512f,avx512dq")]
    fn check_wide() {
        check::<Wide>();
    }

    #[test]
    fn every_kind_of_register_computes_as_numbers_do() {
        check::<Portable>();
        // SAFETY: the processor has just said that it has what is used.
        if has_quads() {
            unsafe { check_quads() };
        }
        if Wide::available() {
            unsafe { check_wide() };
        }
    }
}
