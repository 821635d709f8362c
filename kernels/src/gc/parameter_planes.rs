//! Where the parameters of a region lie.

use crate::parameters::Form;
use crate::region::Region;

/// Activated parameters of a region.
#[derive(Clone, Copy, Debug)]
pub struct ParameterPlanes<'a> {
    /// Which parameters there are.
    pub form: Form,
    /// Planes of a picture that holds the region.
    pub values: &'a [f32],
    /// Where the region's first pixel lies in a plane.
    pub start: usize,
    /// Floats from one parameter to the next.
    pub plane: usize,
    /// Floats from one row to the next.
    pub row: usize,
}

impl<'a> ParameterPlanes<'a> {
    /// Parameters `[P, region.height, region.width]` of one region alone.
    pub fn of_region(form: Form, values: &'a [f32], region: &Region) -> Self {
        Self { form, values, start: 0, plane: region.pixels(), row: region.width }
    }

    /// Those from so many pixels below and right of the first on.
    pub fn offset_by(self, down: usize, right: usize) -> Self {
        Self { start: self.start + down * self.row + right, ..self }
    }

    pub(super) fn check(&self, region: &Region) {
        let last =
            self.start + (self.form.parameters() - 1) * self.plane + (region.height - 1) * self.row + region.width;
        assert!(last <= self.values.len() && region.width <= self.row, "parameters cover the region");
    }
}
