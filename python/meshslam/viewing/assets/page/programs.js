// WebGL: programs for lit meshes and for lines of a width in pixels, and their buffers.
const makePrograms = (gl) => {
  const program = (vertex, fragment) => {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, "#version 300 es\nprecision highp float;\n" + source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    const places = new Map();
    made.at = (name) => {
      if (!places.has(name)) places.set(name, gl.getUniformLocation(made, name));
      return places.get(name);
    };
    return made;
  };
  const meshes = program(`
    layout(location = 0) in vec3 place; layout(location = 1) in vec3 normal; layout(location = 2) in vec2 known;
    uniform mat4 view; out vec3 n, p; out vec2 k;
    void main() { n = normal; p = place; k = known; gl_Position = view * vec4(place, 1.0); }`, `
    in vec3 n, p; in vec2 k; uniform vec3 colour, eye, prior, low, half_way, high; uniform int by; uniform vec2 range; uniform float opacity;
    out vec4 pixel;
    void main() {
      vec3 base = colour;
      float t = clamp(log(max(k.x, 1e-4) / range.x) / log(range.y / range.x), 0.0, 1.0);
      if (by == 1) base = k.x < 0.0 ? prior : t < 0.5 ? mix(low, half_way, 2.0 * t) : mix(half_way, high, 2.0 * t - 1.0);
      if (by == 2) base = mix(prior, colour, k.y < 0.0 ? 0.0 : smoothstep(0.35, 0.65, k.y));
      vec3 flatly = normalize(cross(dFdx(p), dFdy(p)));
      vec3 m = normalize(mix(normalize(n), flatly, 0.55)), e = normalize(eye - p);
      float sky = 0.5 + 0.5 * m.z, sun = max(dot(m, normalize(vec3(.35, .25, .9))), 0.0), front = max(dot(m, e), 0.0);
      vec3 lit = base * (0.28 + 0.27 * sky + 0.30 * sun + 0.25 * front) + vec3(.10) * pow(front, 8.0);
      pixel = vec4(lit, 1.0) * opacity;
    }`);
  const lines = program(`
    layout(location = 0) in vec2 corner; layout(location = 1) in vec3 a; layout(location = 2) in vec3 b; layout(location = 3) in vec2 along;
    uniform mat4 view; uniform vec2 size; uniform float width; out vec3 p; out float s;
    void main() {
      vec4 c = view * vec4(a, 1.0), d = view * vec4(b, 1.0);
      float near = 0.02;
      vec4 u = c.w < near && d.w > near ? mix(c, d, (near - c.w) / (d.w - c.w)) : c;
      vec4 v = d.w < near && c.w > near ? mix(d, c, (near - d.w) / (c.w - d.w)) : d;
      vec2 way = (v.xy / v.w - u.xy / u.w) * size;
      way = length(way) > 1e-6 ? normalize(way) : vec2(1.0, 0.0);
      gl_Position = corner.x < 0.5 ? u : v;
      p = corner.x < 0.5 ? a : b;
      s = corner.x < 0.5 ? along.x : along.y;
      gl_Position.xy += corner.y * width * vec2(-way.y, way.x) / size * gl_Position.w;
    }`, `
    in vec3 p; in float s; uniform vec4 colour; uniform vec3 middle; uniform float reach, dash; out vec4 pixel;
    void main() {
      if (dash > 0.0 && fract(s / dash) > 0.6) discard;
      float o = colour.a * (1.0 - smoothstep(0.4 * reach, reach, distance(p, middle)));
      pixel = vec4(colour.rgb * o, o);
    }`);

  const thin = program(`
    layout(location = 0) in vec3 place; uniform mat4 view;
    void main() { gl_Position = view * vec4(place, 1.0); }`, `
    uniform vec4 colour; out vec4 pixel;
    void main() { pixel = vec4(colour.rgb * colour.a, colour.a); }`);

  const buffer = (data) => {
    const made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return made;
  };
  const attribute = (location, data, size, stride = 0, offset = 0) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, data);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, gl.FLOAT, false, stride, offset);
  };
  // Segments: two ends of three numbers each; for dashes the length of the way to each end. Four corners a segment, not
  // instances, which a browser without a GPU draws one by one.
  const segments = (ends) => {
    const count = ends.length / 6, rows = new Float32Array(40 * count), index = new Uint32Array(6 * count), array = gl.createVertexArray();
    let way = 0;
    for (let i = 0; i < count; i++) {
      const two = ends.slice(6 * i, 6 * i + 6), before = way;
      way += Math.hypot(two[3] - two[0], two[4] - two[1], two[5] - two[2]);
      [[0, -1], [0, 1], [1, -1], [1, 1]].forEach((corner, k) => rows.set([...corner, ...two, before, way], 40 * i + 10 * k));
      index.set([0, 1, 2, 2, 1, 3].map((k) => 4 * i + k), 6 * i);
    }
    gl.bindVertexArray(array);
    const data = buffer(rows), order = gl.createBuffer();
    [[0, 2, 0], [1, 3, 8], [2, 3, 20], [3, 2, 32]].forEach(([location, size, offset]) => attribute(location, data, size, 40, offset));
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, order);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.STATIC_DRAW);
    const free = () => { gl.deleteBuffer(data); gl.deleteBuffer(order); gl.deleteVertexArray(array); };
    return { array, count: 6 * count, free };
  };
  // Lines as thin as a pixel, all in one: a true mesh has a thousand of them.
  const wires = (ends) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    attribute(0, buffer(ends), 3);
    return { array, count: ends.length / 3 };
  };
  const mesh = (object) => {
    const { place: p, topology: { faces }, known } = object, normal = new Float32Array(p.length), array = gl.createVertexArray();
    for (let f = 0; f < faces.length; f += 3) {
      const [i, j, k] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
      const ax = p[j] - p[i], ay = p[j + 1] - p[i + 1], az = p[j + 2] - p[i + 2], bx = p[k] - p[i], by = p[k + 1] - p[i + 1], bz = p[k + 2] - p[i + 2];
      const n = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
      for (const c of [i, j, k]) for (let r = 0; r < 3; r++) normal[c + r] += n[r];
    }
    gl.bindVertexArray(array);
    attribute(0, buffer(p), 3);
    attribute(1, buffer(normal), 3);
    attribute(2, buffer(known), 2);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    return { array, count: faces.length };
  };
  return { meshes, lines, thin, segments, wires, mesh };
};

// Draws the map's meshes into a canvas for any standpoint; null without WebGL 2.
const makeMeshes = (canvas, run) => {
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
  if (!gl) return null;
  const programs = makePrograms(gl), buffers = new Map(run.objects.map((o) => [o.id, programs.mesh(o)]));
  const rgb = (place, colour) => gl.uniform3f(place, colour[0] / 255, colour[1] / 255, colour[2] / 255);
  const one = (object, colouring, opacity) => {
    const at = programs.meshes.at;
    rgb(at("colour"), colouring === "seen" ? themed("--seen") : colouring === "sigma" ? object.colour : colourOf(object, colouring));
    gl.uniform1f(at("opacity"), opacity);
    const { array, count } = buffers.get(object.id);
    gl.bindVertexArray(array);
    gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
  };
  // `faded` objects are laid over the others, the farthest first, each without its own far side.
  const draw = (view, eye, colouring, faded = () => false) => {
    const at = programs.meshes.at;
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(programs.meshes);
    gl.uniformMatrix4fv(at("view"), false, view);
    gl.uniform3f(at("eye"), ...eye);
    rgb(at("prior"), themed("--prior"));
    ["low", "half_way", "high"].forEach((name, i) => rgb(at(name), RAMP[i]));
    gl.uniform1i(at("by"), { id: 0, error: 0, sigma: 1, seen: 2 }[colouring]);
    gl.uniform2f(at("range"), ...VERTEX_SIGMAS_M);
    gl.disable(gl.BLEND);
    gl.depthFunc(gl.LESS);
    const shows = sphereTest(view), seen = run.objects.filter((o) => shows(o.centre, o.radius));
    seen.filter((o) => !faded(o)).forEach((o) => one(o, colouring, 1));
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const far = (o) => Math.hypot(...sub(o.centre, eye));
    for (const o of seen.filter(faded).sort((a, b) => far(b) - far(a))) {
      gl.colorMask(false, false, false, false);
      one(o, colouring, 0);
      gl.colorMask(true, true, true, true);
      gl.depthFunc(gl.LEQUAL);
      one(o, colouring, 0.38);
      gl.depthFunc(gl.LESS);
    }
  };
  const clear = (width, height) => {
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  };
  return { gl, programs, draw, clear };
};
