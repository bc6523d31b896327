function [theta_bar_deg, steps_deg, axis] = rotdrift_score(file)
% ROTDRIFT_SCORE  Rotation drift of the benchmark card RAL-SI-2020-B19-0838.4-V1.0.
%
%   [theta_bar_deg, steps_deg, axis] = rotdrift_score('endpoints.csv')
%
% The file is what `rotdrift convert TRIAL endpoints.csv --to endpoints` writes (also in every submission): a header
% with columns qw, qx, qy, qz (unit quaternions, scalar first, Hamilton, object to world), one row per end point.
% Runs in MATLAB and in GNU Octave without any toolbox.
  q = read_quaternions(file);
  n = size(q, 1);
  if n < 2
    error('rotdrift_score:few', 'a drift needs at least 2 end points, the file has %d', n);
  end
  q = bsxfun(@rdivide, q, sqrt(sum(q.^2, 2)));
  r = zeros(n - 1, 4);
  for k = 1:n - 1
    r(k, :) = multiply(q(k + 1, :), [q(k, 1), -q(k, 2:4)]);   % step 2: r = q(i+1) * inv(q(i)), world frame
  end
  % Step 3: eigenvector of the largest eigenvalue of sum r r'. Taken relative to the first step, then turned back:
  % the same vector, but small angles keep their digits.
  first = r(1, :);
  relative = zeros(size(r));
  for k = 1:n - 1
    relative(k, :) = multiply(r(k, :), [first(1), -first(2:4)]);
  end
  [vectors, values] = eig(relative' * relative);
  [~, top] = max(diag(values));
  mean_step = multiply(vectors(:, top)', first);
  theta_bar_deg = angle_deg(mean_step);                        % step 4
  steps_deg = zeros(n - 1, 1);
  for k = 1:n - 1
    steps_deg(k) = angle_deg(r(k, :));
  end
  if mean_step(1) < 0
    mean_step = -mean_step;
  end
  axis = mean_step(2:4) / max(norm(mean_step(2:4)), realmin);
end

function deg = angle_deg(q)
% 2 acos(|w|) is 0 below 1e-6 degrees; this is the same angle with all its digits.
  deg = 2 * atan2(norm(q(2:4)), abs(q(1))) * 180 / pi;
end

function p = multiply(a, b)
% Hamilton product of two row quaternions.
  v = a(1) * b(2:4) + b(1) * a(2:4) + cross(a(2:4), b(2:4));
  p = [a(1) * b(1) - a(2:4) * b(2:4)', v];
end

function q = read_quaternions(file)
  handle = fopen(file, 'r');
  if handle < 0
    error('rotdrift_score:file', 'cannot open %s', file);
  end
  header = strsplit(strtrim(fgetl(handle)), ',');
  if ~any(strcmp(header, 'endpoint'))
    warning('rotdrift_score:samples', '%s has no column endpoint: are these end points, not samples?', file);
  end
  columns = zeros(1, 4);
  names = {'qw', 'qx', 'qy', 'qz'};
  for k = 1:4
    found = find(strcmp(header, names{k}));
    if isempty(found)
      fclose(handle);
      error('rotdrift_score:header', 'no column %s in %s', names{k}, file);
    end
    columns(k) = found(1);
  end
  q = zeros(0, 4);
  line = fgetl(handle);
  while ischar(line)
    cells = strsplit(strtrim(line), ',', 'CollapseDelimiters', false);
    if numel(cells) >= max(columns)
      q(end + 1, :) = str2double(cells(columns)); %#ok<AGROW>
    end
    line = fgetl(handle);
  end
  fclose(handle);
end
