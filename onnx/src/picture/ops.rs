//! A graph under construction whose values name themselves.

use crate::builder::{GraphBuilder, int, ints};
use crate::messages::{AttributeProto, GraphProto, data_type};

/// Largest finite f32: a value is finite where its magnitude is no larger.
const LARGEST: f32 = f32::MAX;

/// Operators by short names; each returns the name of its result. Constants are made once.
pub(super) struct Ops {
    pub graph: GraphBuilder,
    /// What the names begin with, so that two of these can be one graph.
    stem: &'static str,
    count: usize,
    constants: Vec<String>,
}

/// An operator of two values.
macro_rules! binary {
    ($($name:ident $operator:literal),*) => {
        $(pub fn $name(&mut self, a: &str, b: &str) -> String { self.op($operator, &[a, b]) })*
    };
}

/// An operator of one value.
macro_rules! unary {
    ($($name:ident $operator:literal),*) => {
        $(pub fn $name(&mut self, a: &str) -> String { self.op($operator, &[a]) })*
    };
}

impl Ops {
    pub fn new(graph: &str, stem: &'static str) -> Self {
        Self { graph: GraphBuilder::new(graph), stem, count: 0, constants: Vec::new() }
    }

    pub fn finish(self) -> GraphProto {
        self.graph.finish()
    }

    binary!(add "Add", sub "Sub", mul "Mul", div "Div", max "Max", min "Min", matmul "MatMul", and "And", or "Or");
    binary!(equal "Equal", greater "Greater", less "Less", reshape "Reshape", modulo "Mod");
    unary!(abs "Abs", neg "Neg", not "Not", log "Log", exp "Exp", sqrt "Sqrt", shape "Shape", relu "Relu");

    pub fn op(&mut self, operator: &str, inputs: &[&str]) -> String {
        self.op_with(operator, inputs, Vec::new())
    }

    pub fn op_with(&mut self, operator: &str, inputs: &[&str], attributes: Vec<AttributeProto>) -> String {
        let name = self.name(operator);
        self.graph.op_with(operator, inputs, &name, attributes)
    }

    /// An operator of several results.
    pub fn several(
        &mut self,
        operator: &str,
        inputs: &[&str],
        results: usize,
        with: Vec<AttributeProto>,
    ) -> Vec<String> {
        let names: Vec<String> = (0..results).map(|_| self.name(operator)).collect();
        self.graph.node(operator, inputs, &names.iter().map(String::as_str).collect::<Vec<_>>(), with);
        names
    }

    fn name(&mut self, operator: &str) -> String {
        self.count += 1;
        format!("{}{}_{}", self.stem, operator.to_lowercase(), self.count)
    }

    /// A scalar.
    pub fn float(&mut self, value: f32) -> String {
        let name = format!("{}float_{value:e}", self.stem);
        if !self.constants.contains(&name) {
            self.constants.push(self.graph.floats(&name, &[], &[value]));
        }
        name
    }

    /// A scalar as float64; its value must be one of float32.
    pub fn double(&mut self, value: f32) -> String {
        let value = self.float(value);
        self.cast(&value, data_type::DOUBLE)
    }

    /// Integers `[n]`.
    pub fn ints(&mut self, values: &[i64]) -> String {
        let text: Vec<String> = values.iter().map(i64::to_string).collect();
        let name = format!("{}ints_{}", self.stem, text.join("_"));
        if !self.constants.contains(&name) {
            self.constants.push(self.graph.ints(&name, &[values.len()], values));
        }
        name
    }

    /// An integer without dimensions.
    pub fn int(&mut self, value: i64) -> String {
        let name = format!("{}int_{value}", self.stem);
        if !self.constants.contains(&name) {
            self.constants.push(self.graph.ints(&name, &[], &[value]));
        }
        name
    }

    pub fn add_to(&mut self, a: &str, value: f32) -> String {
        let value = self.float(value);
        self.add(a, &value)
    }

    pub fn times(&mut self, a: &str, value: f32) -> String {
        let value = self.float(value);
        self.mul(a, &value)
    }

    pub fn square(&mut self, a: &str) -> String {
        self.mul(a, a)
    }

    /// `a` where a condition holds, `b` elsewhere.
    pub fn choose(&mut self, condition: &str, a: &str, b: &str) -> String {
        self.op("Where", &[condition, a, b])
    }

    /// z + share (x - z).
    pub fn mix(&mut self, z: &str, x: &str, share: &str) -> String {
        let apart = self.sub(x, z);
        let kept = self.mul(share, &apart);
        self.add(z, &kept)
    }

    pub fn concat(&mut self, parts: &[&str], axis: i64) -> String {
        self.op_with("Concat", parts, vec![int("axis", axis)])
    }

    pub fn split(&mut self, value: &str, sizes: &[i64], axis: i64) -> Vec<String> {
        let groups = self.ints(sizes);
        self.several("Split", &[value, &groups], sizes.len(), vec![int("axis", axis)])
    }

    pub fn gather(&mut self, value: &str, indices: &str, axis: i64) -> String {
        self.op_with("Gather", &[value, indices], vec![int("axis", axis)])
    }

    pub fn transpose(&mut self, value: &str, order: &[i64]) -> String {
        self.op_with("Transpose", &[value], vec![ints("perm", order)])
    }

    pub fn slice(&mut self, value: &str, start: &str, end: &str, axes: &[i64]) -> String {
        let axes = self.ints(axes);
        self.op("Slice", &[value, start, end, &axes])
    }

    /// One index of an axis, which stays with size 1.
    pub fn at(&mut self, value: &str, index: i64, axis: i64) -> String {
        let (start, end) = (self.ints(&[index]), self.ints(&[index + 1]));
        self.slice(value, &start, &end, &[axis])
    }

    /// Sums over axes, which stay with size 1; over all where none is named.
    pub fn sum_over(&mut self, value: &str, axes: &[i64]) -> String {
        match axes {
            [] => self.op("ReduceSum", &[value]),
            axes => {
                let axes = self.ints(axes);
                self.op("ReduceSum", &[value, &axes])
            }
        }
    }

    /// Another reduction over axes, which stay with size 1.
    pub fn reduce(&mut self, operator: &str, value: &str, axes: &[i64]) -> String {
        self.op_with(operator, &[value], vec![ints("axes", axes), int("keepdims", 1)])
    }

    pub fn cast(&mut self, value: &str, kind: i32) -> String {
        self.op_with("Cast", &[value], vec![int("to", kind.into())])
    }

    pub fn as_float(&mut self, value: &str) -> String {
        self.cast(value, data_type::FLOAT)
    }

    /// Whether values are neither NaN nor infinite.
    pub fn is_finite(&mut self, value: &str) -> String {
        let (magnitude, largest) = (self.abs(value), self.float(LARGEST));
        self.op("LessOrEqual", &[&magnitude, &largest])
    }

    /// Whether a number is above one half: masks as numbers become conditions.
    pub fn is_set(&mut self, number: &str) -> String {
        let half = self.float(0.5);
        self.greater(number, &half)
    }

    pub fn clip(&mut self, value: &str, least: f32, most: f32) -> String {
        let (least, most) = (self.float(least), self.float(most));
        self.op("Clip", &[value, &least, &most])
    }

    /// Whether all channels (axis 1) of a mask hold, or, of `Max`, any.
    pub fn channels(&mut self, reduction: &str, mask: &str) -> String {
        let number = self.as_float(mask);
        let reduced = self.reduce(reduction, &number, &[1]);
        self.is_set(&reduced)
    }

    /// Size along an axis as `[1]`.
    pub fn size(&mut self, value: &str, axis: i64) -> String {
        let (shape, axis) = (self.shape(value), self.ints(&[axis]));
        self.gather(&shape, &axis, 0)
    }

    /// `[1]` integers n to n rounded up to a multiple.
    pub fn round_up(&mut self, n: &str, multiple: i64) -> String {
        let (less, multiple) = (self.ints(&[multiple - 1]), self.ints(&[multiple]));
        let lifted = self.add(n, &less);
        let times = self.div(&lifted, &multiple);
        self.mul(&times, &multiple)
    }

    pub fn reshape_to(&mut self, value: &str, shape: &[i64]) -> String {
        let shape = self.ints(shape);
        self.reshape(value, &shape)
    }

    /// 0, step, 2 step, ... below a length `[1]`, in a shape.
    pub fn range_of(&mut self, length: &str, step: i64, shape: &[i64]) -> String {
        let (start, step, none) = (self.int(0), self.int(step), self.ints(&[]));
        let length = self.reshape(length, &none);
        let range = self.op("Range", &[&start, &length, &step]);
        self.reshape_to(&range, shape)
    }

    /// The left upper part of a picture, of a height and width `[1]` each.
    pub fn crop(&mut self, picture: &str, height: &str, width: &str) -> String {
        let (start, end) = (self.ints(&[0, 0]), self.concat(&[height, width], 0));
        self.slice(picture, &start, &end, &[2, 3])
    }

    /// A picture `[N, C, H, W]` with zeros below and on the right up to a height and width, `[1]` each.
    pub fn pad_to(&mut self, picture: &str, height: &str, width: &str) -> String {
        let (old_height, old_width) = (self.size(picture, 2), self.size(picture, 3));
        let (rows, columns) = (self.sub(height, &old_height), self.sub(width, &old_width));
        let zeros = self.ints(&[0; 6]);
        let pads = self.concat(&[&zeros, &rows, &columns], 0);
        self.op("Pad", &[picture, &pads])
    }

    /// Maximum of each block of a picture whose size is a multiple of it.
    pub fn pool_max(&mut self, picture: &str, block: [i64; 2]) -> String {
        self.op_with("MaxPool", &[picture], vec![ints("kernel_shape", &block), ints("strides", &block)])
    }

    /// Blocks' values `[N, C, rows, columns]` for every pixel of a picture of a height and width, `[1]` each.
    pub fn enlarge(&mut self, blocks: &str, block: [i64; 2], height: &str, width: &str) -> String {
        let mut enlarged = blocks.to_string();
        for (axis, length, size) in [(2, height, block[0]), (3, width, block[1])] {
            let (pixels, size) = (self.range_of(length, 1, &[-1]), self.int(size));
            let indices = self.div(&pixels, &size);
            enlarged = self.gather(&enlarged, &indices, axis);
        }
        enlarged
    }

    /// Mean over the (2 radius + 1)² neighbours that lie inside the picture.
    pub fn box_mean(&mut self, picture: &str, radius: i64) -> String {
        let along = |kernel: [i64; 2], pads: [i64; 4]| vec![ints("kernel_shape", &kernel), ints("pads", &pads)];
        let length = 2 * radius + 1;
        let rows = self.op_with("AveragePool", &[picture], along([1, length], [0, radius, 0, radius]));
        self.op_with("AveragePool", &[&rows], along([length, 1], [radius, 0, radius, 0]))
    }
}
