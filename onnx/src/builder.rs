//! Helpers that add nodes, constants, inputs and outputs to a graph.

use crate::messages::*;

/// A graph under construction. Methods that add a value return its name.
#[derive(Default)]
pub(crate) struct GraphBuilder {
    graph: GraphProto,
}

/// One dimension of an input or output.
#[derive(Clone, Copy)]
pub(crate) enum Dim {
    Size(usize),
    Named(&'static str),
    /// Neither a size nor a name: given by the input.
    Free,
}

impl GraphBuilder {
    pub fn new(name: &str) -> Self {
        Self { graph: GraphProto { name: Some(name.into()), ..Default::default() } }
    }

    /// The graph so far.
    pub fn graph_mut(&mut self) -> &mut GraphProto {
        &mut self.graph
    }

    pub fn finish(self) -> GraphProto {
        self.graph
    }

    /// A node with one output, which names the node.
    pub fn op(&mut self, op: &str, inputs: &[&str], output: &str) -> String {
        self.op_with(op, inputs, output, Vec::new())
    }

    pub fn op_with(&mut self, op: &str, inputs: &[&str], output: &str, attributes: Vec<AttributeProto>) -> String {
        self.node(op, inputs, &[output], attributes);
        output.to_string()
    }

    /// A node with one output of another domain than ONNX's own.
    pub fn op_of(
        &mut self,
        domain: &str,
        op: &str,
        inputs: &[&str],
        output: &str,
        with: Vec<AttributeProto>,
    ) -> String {
        self.node(op, inputs, &[output], with);
        self.graph.node.last_mut().expect("it was added").domain = Some(domain.into());
        output.to_string()
    }

    /// A node with any number of outputs.
    pub fn node(&mut self, op: &str, inputs: &[&str], outputs: &[&str], attribute: Vec<AttributeProto>) {
        self.graph.node.push(NodeProto {
            input: inputs.iter().map(|s| s.to_string()).collect(),
            output: outputs.iter().map(|s| s.to_string()).collect(),
            name: Some(outputs[0].to_string()),
            op_type: Some(op.to_string()),
            attribute,
            domain: None,
        });
    }

    /// A float32 initialiser; an empty `dims` makes a scalar.
    pub fn floats(&mut self, name: &str, dims: &[usize], values: &[f32]) -> String {
        let raw = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.initializer(name, dims, data_type::FLOAT, raw)
    }

    /// An int64 initialiser; an empty `dims` makes a scalar.
    pub fn ints(&mut self, name: &str, dims: &[usize], values: &[i64]) -> String {
        let raw = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.initializer(name, dims, data_type::INT64, raw)
    }

    /// A bool initialiser.
    pub fn bools(&mut self, name: &str, dims: &[usize], values: &[bool]) -> String {
        let raw = values.iter().map(|&v| v as u8).collect();
        self.initializer(name, dims, data_type::BOOL, raw)
    }

    fn initializer(&mut self, name: &str, dims: &[usize], kind: i32, raw: Vec<u8>) -> String {
        self.graph.initializer.push(TensorProto {
            dims: dims.iter().map(|&d| d as i64).collect(),
            data_type: Some(kind),
            name: Some(name.to_string()),
            raw_data: Some(raw),
            ..Default::default()
        });
        name.to_string()
    }

    pub fn input(&mut self, name: &str, kind: i32, dims: &[Dim]) {
        self.graph.input.push(value_info(name, kind, dims));
    }

    pub fn output(&mut self, name: &str, kind: i32, dims: &[Dim]) {
        self.graph.output.push(value_info(name, kind, dims));
    }
}

fn value_info(name: &str, kind: i32, dims: &[Dim]) -> ValueInfoProto {
    let dim = dims
        .iter()
        .map(|dim| match *dim {
            Dim::Size(size) => Some(DimensionValue::Size(size as i64)),
            Dim::Named(name) => Some(DimensionValue::Name(name.to_string())),
            Dim::Free => None,
        })
        .map(|value| Dimension { value })
        .collect();
    let tensor = TensorType { elem_type: Some(kind), shape: Some(TensorShapeProto { dim }) };
    ValueInfoProto { name: Some(name.to_string()), r#type: Some(TypeProto { tensor_type: Some(tensor) }) }
}

/// An integer attribute.
pub(crate) fn int(name: &str, value: i64) -> AttributeProto {
    AttributeProto {
        name: Some(name.into()),
        i: Some(value),
        r#type: Some(AttributeType::Int as i32),
        ..Default::default()
    }
}

/// An attribute of several integers.
pub(crate) fn ints(name: &str, values: &[i64]) -> AttributeProto {
    AttributeProto {
        name: Some(name.into()),
        ints: values.to_vec(),
        r#type: Some(AttributeType::Ints as i32),
        ..Default::default()
    }
}

/// An attribute that is a tensor of one float32.
pub(crate) fn tensor(name: &str, value: f32) -> AttributeProto {
    let tensor = TensorProto {
        dims: vec![1],
        data_type: Some(data_type::FLOAT),
        raw_data: Some(value.to_le_bytes().to_vec()),
        ..Default::default()
    };
    AttributeProto {
        name: Some(name.into()),
        t: Some(tensor),
        r#type: Some(AttributeType::Tensor as i32),
        ..Default::default()
    }
}

/// A subgraph attribute.
pub(crate) fn subgraph(name: &str, graph: GraphProto) -> AttributeProto {
    AttributeProto {
        name: Some(name.into()),
        g: Some(graph),
        r#type: Some(AttributeType::Graph as i32),
        ..Default::default()
    }
}
