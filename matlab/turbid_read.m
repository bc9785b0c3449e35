function out = turbid_read(file, selector, varargin)
% TURBID_READ  A stored result of turbid, with units, errors and masks.
%
%   maps = turbid_read('mine.yaml', 'maps')
%   maps = turbid_read('sweep.yaml', 'maps[mu_a=0.1]')
%   rows = turbid_read('sweep.yaml', 'metrics', 'all', true)
%   maps = turbid_read('maps.mat')
%
% With a pipeline file it asks the program `turbid` for STAGE.PORT (or STAGE alone: the first output of the stage); with a .mat file
% that `turbid export` wrote it reads that. Options, as pairs:
%   'all'      true: all instances that fit, stacked; false (default): exactly one
%   'set'      cell array of overrides, as in {'vars.f_x=0.2'}
%   'outputs'  folder of results, if it is not `outputs`
%   'turbid'   the program, if it is not on the path
%
% Image stacks give a structure with
%   .images      single, rows x columns x layers (x instances); row 1 is the top
%   .layers      structure array: name, kind, unit, f_x_per_mm, phase_rad, orientation_deg, wavelength_nm, ..
%   .NAME        the value layers of that name, double, NaN where a pixel is masked; .NAME_se their standard errors
%   .mask        0 where a pixel is good, else the number of the reason (docs/concepts.md)
%   .units       unit of each NAME
%   .x_mm, .y_mm places of the pixels from the middle of the image, y upwards, where the pitch is known
%   .axes        with 'all': a column for each axis
% Tables give a structure with a column vector (or cell array of texts) for each column, axes included, and .units; with the
% structure `attributes` what is said of the whole.
%
% Runs in MATLAB and in GNU Octave.

  if nargin < 2 || isempty(selector)
    out = shaped(load(file));
    return
  end
  options = struct('all', false, 'set', {{}}, 'outputs', '', 'turbid', 'turbid');
  for k = 1:2:numel(varargin)
    if ~isfield(options, varargin{k})
      error('turbid:option', 'turbid_read has no option `%s`', varargin{k});
    end
    options.(varargin{k}) = varargin{k + 1};
  end
  folder = tempname();
  mkdir(folder);
  cleanup = onCleanup(@() remove(folder));
  to = fullfile(folder, 'result.mat');
  command = [quoted(options.turbid) ' export ' quoted(file) ' ' quoted(selector) ' --all --to ' quoted(to)];
  for k = 1:numel(options.set)
    command = [command ' --set ' quoted(options.set{k})];
  end
  if ~isempty(options.outputs)
    command = [command ' --outputs ' quoted(options.outputs)];
  end
  [status, told] = system([command ' 2>&1']);
  if status ~= 0
    error('turbid:program', '%s', strtrim(told));
  end
  % Many images come in several files.
  files = dir(fullfile(folder, '*.mat'));
  if numel(files) > 1
    error('turbid:large', '%s: more than one .mat file holds; export it with `turbid export --all` and read the files', selector);
  end
  read = load(fullfile(folder, files(1).name));
  if ~options.all && isfield(read, 'images') && size(read.images, 4) > 1
    error('turbid:several', '`%s` names %d instances; pick one with [axis=value], or read them with ''all'', true', selector, size(read.images, 4));
  end
  out = shaped(read);
end

function out = shaped(read)
% Quantities by name beside what the file holds.
  out = read;
  if ~isfield(read, 'images')
    return
  end
  layers = read.layers(1, :);
  names = {layers.name};
  kinds = {layers.kind};
  mask = zeros(size(read.images, 1), size(read.images, 2), 1, size(read.images, 4));
  at = find(strcmp(names, 'mask'), 1);
  if ~isempty(at)
    mask = double(read.images(:, :, at, :));
    out.mask = squeezed(mask);
  end
  out.units = struct();
  for name = unique(names)
    here = find(strcmp(names, name{1}));
    field = legal(name{1});
    out.units.(field) = layers(here(1)).unit;
    if strcmp(name{1}, 'mask')
      continue
    end
    values = double(read.images(:, :, here, :));
    if ~strcmp(kinds{here(1)}, 'mask')
      values(repmat(mask ~= 0, [1, 1, numel(here), 1])) = NaN;
    end
    out.(field) = squeezed(values);
  end
  if isfield(read, 'pixel_pitch_mm')
    [rows, columns] = deal(size(read.images, 1), size(read.images, 2));
    out.x_mm = ((1:columns) - (columns + 1) / 2) * read.pixel_pitch_mm(1, 1);
    out.y_mm = ((rows + 1) / 2 - (1:rows)') * read.pixel_pitch_mm(1, 2);
  end
end

function values = squeezed(values)
% Without the dimension of layers where there is one layer, and never a turned image.
  if size(values, 3) == 1 && size(values, 4) > 1
    values = reshape(values, size(values, 1), size(values, 2), size(values, 4));
  end
end

function name = legal(name)
  name = regexprep(name, '[^A-Za-z0-9_]', '_');
  if isempty(regexp(name, '^[A-Za-z]', 'once'))
    name = ['x_' name];
  end
end

function text = quoted(text)
% As one word of the shell.
  if ispc()
    text = ['"' strrep(text, '"', '\"') '"'];
  else
    text = ['''' strrep(text, '''', '''\''''') ''''];
  end
end

function remove(folder)
  files = dir(fullfile(folder, '*'));
  for k = 1:numel(files)
    if ~files(k).isdir
      delete(fullfile(folder, files(k).name));
    end
  end
  rmdir(folder);
end
